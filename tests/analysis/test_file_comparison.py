import io
import json

import numpy as np
import pytest
from campaign_runs import SMALL, write_campaign
from rich.console import Console

from agglom_mpi.analysis.file_comparison import best_objectives, compare, comparison_table, to_json
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.display.run_display import print_wide
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import prepare
from agglom_mpi.runtime.provenance import leg_start
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.schema import RESULTS
from agglom_mpi.storage.table import make_row
from agglom_mpi.storage.writer import CampaignWriter


def file_of(folder, name, objectives, seed=1, changed=("", "")):
    """Return the file of a campaign that was killed when so many strings were judged."""
    text = write_campaign(folder / f"{name}.yaml", **SMALL | {"seed": seed}).read_text()
    assert changed[0] in text
    (folder / f"{name}.yaml").write_text(text.replace(*changed))
    path = folder / f"{name}.h5"
    work = InversionExperiment(load_campaign(folder / f"{name}.yaml"))
    prepare(path, work, accept_code_change=False)
    count = len(objectives)
    parameters = np.full((count, 10), 2.0)
    with CampaignWriter(path) as writer:
        writer.log.begin_leg(**leg_start(1, ""))
        none = np.full((count, 2), -1)
        writer.put_strings(0, 0, np.arange(count), np.zeros(count, int), none, parameters)
        for string, objective in enumerate(objectives):
            growth = {"mean_radius_ratio": 1.9, "mean_grains": 7.0, "growth_number": 6.9}
            row = make_row(
                RESULTS.dtype,
                string=string,
                objective=objective,
                standard_error=0.01,
                samples_used=10,
                failed=0,
                hit_maximum=False,
                **growth,
            )
            writer.put_result(row)
    return read_campaign(path)


def said(files):
    return drawn(comparison_table(compare(files)), 200)


def drawn(content, width):
    out = io.StringIO()
    Console(file=out, width=width).print(content)
    return out.getvalue()


def test_a_pipe_gets_all_columns(tmp_path, capsys):
    long = "a_campaign_with_a_name_that_says_all_about_it"
    files = [file_of(tmp_path, f"{long}_{n}", [0.3]) for n in (1, 2)]
    print_wide(comparison_table(compare(files)))
    shown = capsys.readouterr().out
    assert "best as searched" in shown.splitlines()[0]
    assert shown.count("0.300 ± 0.010") == 2
    assert "…" not in shown


def test_the_best_strings_of_seeds_have_a_median_and_a_range(tmp_path):
    files = [
        file_of(tmp_path, f"seed{seed}", values, seed)
        for seed, values in [(1, [0.3, 0.1]), (2, [0.4, 0.2]), (3, [0.5])]
    ]
    found = compare(files)
    assert best_objectives(found) == {"as searched": [0.1, 0.2, 0.5], "re-estimated": []}
    assert found.comparable
    assert found.differences == {"seed": [1, 2, 3]}
    text = said(files)
    assert "best strings of 3 files, as searched: median 0.2000, from 0.1000 to 0.5000" in text
    assert "re-estimated:" not in text
    assert "seed: 1, 2, 3\n" in text
    assert "0.100 ± 0.010" in text


def test_other_questions_are_not_compared(tmp_path):
    changed = ("growth_target, ratio: 2", "growth_target, ratio: 3")
    files = [file_of(tmp_path, "two", [0.1]), file_of(tmp_path, "three", [0.2], changed=changed)]
    assert not compare(files).comparable
    assert "not of the same question" in said(files)
    assert "median" not in said(files)


def test_a_file_without_a_result_is_a_row_without_a_value(tmp_path):
    files = [file_of(tmp_path, "one", [0.1]), file_of(tmp_path, "none", [], seed=2)]
    assert best_objectives(compare(files))["as searched"] == [0.1]
    assert str(files[1].path) in said(files)
    assert json.loads(to_json(compare(files)))["files"][1]["best"] == []


def estimated(summary, objective):
    """Return a summary whose best string was estimated again."""
    again = {"objective": objective, "standard_error": 0.01}
    return summary | {"best": [summary["best"][0] | {"reestimate": again}]}


def test_re_estimates_are_not_mixed_with_objectives_as_searched(tmp_path):
    files = [file_of(tmp_path, f"seed{seed}", [0.1 * seed], seed) for seed in (1, 2, 3)]
    found = compare(files)
    one, two, three = found.summaries
    found = found._replace(summaries=[estimated(one, 0.5), two, estimated(three, 0.7)])
    objectives = best_objectives(found)
    assert objectives["as searched"] == pytest.approx([0.1, 0.2, 0.3])
    assert objectives["re-estimated"] == [0.5, 0.7]
    out = io.StringIO()
    Console(file=out, width=200).print(comparison_table(found))
    assert "of 3 files, as searched: median 0.2000, from 0.1000 to 0.3000" in out.getvalue()
    assert "of 2 files, re-estimated: median 0.6000, from 0.5000 to 0.7000" in out.getvalue()


def constrained(folder, name, *constraints, derived=""):
    text = "".join(f"  - {each}\n" for each in constraints)
    sections = f"{derived}constraints:\n{text}objective:"
    return file_of(folder, name, [0.1], changed=("objective:", sections))


def test_constraints_are_printed_as_they_are_written(tmp_path):
    both, one, other = "relative_speed > 1 m/s", "density > 1.2 g/cm^3", "hardness < 100 MPa"
    files = [
        constrained(tmp_path, "one", one, both),
        constrained(tmp_path, "other", both, other, one),
        file_of(tmp_path, "none", [0.1]),
    ]
    assert compare(files[:2]).differences == {"constraints": [None, [other]]}
    assert compare(files).differences["constraints"] == [[one, both], [both, other, one], None]
    shown = said(files[:2])
    assert "constraints:\n  file 1: none\n  file 2: hardness < 100 MPa\n" in shown
    assert "100000000" not in shown


def test_constraints_of_derived_quantities_name_their_definitions(tmp_path):
    pressure = "pressure < 1 MPa"
    files = [
        constrained(tmp_path, f"{n}", pressure, derived=f"derived: {{pressure: {n} * hardness}}\n")
        for n in (2, 3)
    ]
    assert compare(files).differences["constraints"] == [
        [f"{pressure} (pressure = {n} * hardness)"] for n in (2, 3)
    ]


def test_constraints_that_mean_the_same_do_not_differ(tmp_path):
    texts = ("density > 1200 kg/m^3", "density > 1.2 g/cm^3")
    files = [constrained(tmp_path, f"n{n}", text) for n, text in enumerate(texts)]
    assert compare(files).differences == {}


@pytest.mark.parametrize("width", [40, 60, 80])
def test_no_number_is_cut_on_a_narrow_terminal(tmp_path, width):
    compared = comparison_table(compare([file_of(tmp_path, f"n{n}", [0.3]) for n in (1, 2)]))
    wide, narrow = (drawn(compared, columns) for columns in (400, width))
    assert {word for word in wide.split() if word[0].isdigit()} <= set(narrow.split())
    assert "…" not in narrow


def test_json_has_every_summary_and_difference(tmp_path):
    files = [file_of(tmp_path, "one", [0.1]), file_of(tmp_path, "two", [0.1], seed=2)]
    everything = json.loads(to_json(compare(files)))
    assert [file["best"][0]["objective"] for file in everything["files"]] == pytest.approx(
        [0.1] * 2
    )
    assert everything["differences"] == {"seed": [1, 2]}
    assert everything["comparable"] is True
