"""Named quantities of a user's function in runs: rows, messages, decisions, and what reads them."""

import json
import math

import h5py
import numpy as np
import pytest
from campaign_runs import (
    assert_same,
    assert_sound,
    decisions,
    finish,
    invert,
    state,
)
from click.testing import CliRunner
from user_function_runs import write_quantities

import agglom_mpi
from agglom_mpi.cli import main
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import COMPLETED, FAILED, FailureReason
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.scheduling.interface import task_type
from agglom_mpi.statistics import t_95
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.verbs.estimate import estimate
from agglom_mpi.verbs.simulate import simulate

COLUMNS = ["growth", "largest"]


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """Folder of such a campaign and the file of its undisturbed run."""
    folder = tmp_path_factory.mktemp("quantities")
    write_quantities(folder, trace=folder / "trace", final="{strings: 2, samples: 4}")
    finish(folder, "own.yaml", "--allow-code")
    return folder


@pytest.fixture
def agglom(own, monkeypatch):
    """Return a function that runs `agglom` in that folder, in this process."""
    monkeypatch.chdir(own)
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])


def simulated(campaign, samples=3):
    """Return the batch that a rank makes of the first samples of the string in the middle."""
    task = np.zeros(1, task_type(10))
    task["count"], task["parameters"] = samples, campaign.parameters()
    job = SampleRunner(InversionExperiment(campaign), 0).begin(task[0])
    while job.simulate_next():
        pass
    return job.collect()


def test_samples_have_a_column_for_each_quantity_and_decisions_are_of_their_means(own):
    data, campaign = read_campaign(own / "own.h5"), load_campaign(own / "own.yaml", True)
    with h5py.File(own / "own.h5") as file:
        names = list(file["samples"].dtype.names)
        units = dict(zip(names, file["samples"].attrs["field_units"], strict=True))
        assert names[names.index("objective") :][1:3] == COLUMNS
        assert (units["growth"], units["largest"]) == ("1", "m")
    results = data.result_rows()
    assert len(results) == 6
    for result in results:
        rows = data.sample_rows(int(result["string"]))[: result["samples_used"]]
        growth, largest = (rows[name].mean() for name in COLUMNS)
        wanted = (growth / 3.0 - 1.0) ** 2 + largest
        assert result["objective"] == pytest.approx(wanted, rel=1e-12)
        slopes = np.array([2.0 / 3.0 * (growth / 3.0 - 1.0), 1.0])
        spread = np.cov(np.array([rows[name] for name in COLUMNS])) / len(rows)
        error = math.sqrt(slopes @ spread @ slopes)
        assert result["standard_error"] == pytest.approx(error, rel=1e-5)
    outcome = simulate(campaign, data.parameters[0], 0)
    row = data.sample_rows(0)[0]
    assert outcome.quantities == {name: row[name] for name in COLUMNS}
    assert outcome.objective == row["objective"]


def test_a_file_is_sound_and_altered_quantities_are_found(own, tmp_path):
    copy = tmp_path / "copy.h5"
    copy.write_bytes((own / "own.h5").read_bytes())
    said = assert_sound(copy)
    assert "replay: left out" in said
    assert "shape:value" in said
    with h5py.File(copy, "r+") as file:
        row = file["samples"][0]
        row["growth"] += 1e-9
        file["samples"][0] = row
    done = CliRunner().invoke(main, ["check", str(copy)])
    assert done.exit_code == 1
    assert "sample 0 of string 0" in done.output


def test_with_leave_a_file_is_decided_again_and_estimated_by_its_own_copy_of_the_code(
    own, tmp_path, monkeypatch
):
    (tmp_path / "own.h5").write_bytes((own / "own.h5").read_bytes())  # and no module
    monkeypatch.chdir(tmp_path)
    before = (own / "trace").read_text()
    done = CliRunner().invoke(main, ["check", "own.h5", "--allow-code"])
    assert done.exit_code == 0, done.output
    assert "6 of 6 results and 2 of 2 populations" in done.output
    done = CliRunner().invoke(main, ["report", "own.h5", "--json", "--allow-code"])
    best = json.loads(done.stdout)["best"][0]
    quantities, again = best["quantities"], best["reestimate"]
    means = [quantities[name]["estimate"] for name in COLUMNS]
    wanted = (means[0] / 3.0 - 1.0) ** 2 + means[1]
    assert again["objective"] == pytest.approx(wanted, rel=1e-12)
    assert again["standard_error"] > 0.0
    data = agglom_mpi.open_campaign("own.h5", allow_code=True)
    assert data.best(1)["estimate"][0] == again["objective"]
    after = (own / "trace").read_text()
    assert len(after) - len(before) in (0, 1)  # once in this process
    with h5py.File("own.h5", "r+") as file:
        modules = json.loads(file.attrs["own_modules"])
        modules[0]["source"] += "# changed\n"
        file.attrs["own_modules"] = json.dumps(modules)
    done = CliRunner().invoke(main, ["check", "own.h5", "--allow-code"])
    assert "replay: left out" in done.output
    assert (own / "trace").read_text() == after


def test_tables_and_csv_have_means_with_standard_errors(own, tmp_path, agglom):
    file = agglom_mpi.open_campaign(own / "own.h5")
    strings, samples = file.strings, file.samples
    used = samples[samples["used"] & (samples["string"] == 3)]
    [row] = strings[strings["string"] == 3].to_dict("records")
    assert row["growth"] == pytest.approx(used["growth"].mean(), rel=1e-12)
    error = used["largest"].std() / math.sqrt(len(used))
    assert row["largest_standard_error"] == pytest.approx(error, rel=1e-9)
    assert strings.attrs["units"]["largest"] == samples.attrs["units"]["largest"] == "m"
    best = agglom_mpi.open_campaign(own / "own.h5", allow_code=True).best(2)
    fresh = samples[samples["fresh"] & (samples["string"] == best["string"][0])]
    assert len(fresh) == 4
    assert best["estimate_growth"][0] == pytest.approx(fresh["growth"].mean(), rel=1e-12)
    assert agglom("export", "own.h5", "--csv", tmp_path / "tables").exit_code == 0
    header = (tmp_path / "tables" / "strings.csv").read_text().splitlines()[0].split(",")
    assert header[-4:] == [
        "growth",
        "growth_standard_error",
        "largest (m)",
        "largest_standard_error (m)",
    ]


def test_a_report_has_the_quantities_where_the_code_may_run(own, agglom):
    found = json.loads(agglom("report", "own.h5", "--json", "--allow-code").stdout)
    quantities = found["best"][0]["quantities"]
    assert list(quantities) == COLUMNS
    assert quantities["largest"]["unit"] == "m"
    assert quantities["largest"]["standard_error"] > 0.0
    assert quantities["growth"]["estimate"] > 1.0
    text = agglom("report", "own.h5", "--allow-code").stdout
    assert "largest m, as searched" in text
    assert "growth, re-estimate" in text


@pytest.mark.parametrize("arguments", [("report",), ("simulate", "--string", 1, "--sample", 2)])
def test_without_the_code_a_file_is_its_tables_and_runs_none(own, agglom, arguments):
    before = (own / "trace").read_text()
    done = agglom(arguments[0], "own.h5", *arguments[1:])
    assert done.exit_code == (0 if arguments == ("report",) else 2)
    assert "own.h5 has code of its own (shape:value)" in done.output
    assert (own / "trace").read_text() == before


def test_a_run_that_may_run_the_code_shows_its_estimates_at_the_end(own, tmp_path):
    write_quantities(tmp_path, final="{strings: 2, samples: 4}")
    done = invert(tmp_path, "own.yaml", "--allow-code")
    assert done.returncode == 0
    assert "fresh samples" in done.stdout + done.stderr
    assert "re-estimate " in done.stdout + done.stderr
    assert_same(tmp_path / "own.h5", decisions(own / "own.h5"))


def test_a_forward_run_has_means_and_the_objective_of_the_means(own, agglom):
    done = agglom("simulate", "own.yaml", "--allow-code", "--samples", 5, "--json")
    found = json.loads(done.stdout)
    campaign = load_campaign(own / "own.yaml", allow_code=True)
    samples = [simulate(campaign, {}, sample).quantities for sample in range(5)]
    means = {name: np.mean([each[name] for each in samples]) for name in COLUMNS}
    assert found["quantities"]["growth"]["mean"] == pytest.approx(means["growth"], rel=1e-12)
    assert found["quantities"]["largest"]["unit"] == "m"
    value = (means["growth"] / 3.0 - 1.0) ** 2 + means["largest"]
    assert found["objective"]["mean"] == pytest.approx(value, rel=1e-12)
    means = estimate(campaign, {}, samples=5)
    assert means.quantities["largest"].error == found["quantities"]["largest"]["standard_error"]
    assert "largest_m" in str(means)


def test_a_compact_copy_has_the_same_columns(own, tmp_path, agglom):
    small = tmp_path / "small.h5"
    assert agglom("export", "own.h5", "--compact", small).exit_code == 0
    both = [read_campaign(path).all_sample_rows() for path in (own / "own.h5", small)]
    assert both[0].tobytes() == both[1].tobytes()
    assert_sound(small)


def test_a_resume_ends_as_one_run_does(own, tmp_path):
    write_quantities(tmp_path, final="{strings: 2, samples: 4}")
    finish(tmp_path, "own.yaml", "--allow-code", "--generations", "1")
    finish(tmp_path, "own.yaml", "--allow-code")
    assert_same(tmp_path / "own.h5", decisions(own / "own.h5"))


def test_other_quantities_or_functions_are_another_campaign(own, tmp_path):
    write_quantities(tmp_path)
    (tmp_path / "own.h5").write_bytes((own / "own.h5").read_bytes())
    path = tmp_path / "own.yaml"
    path.write_text(path.read_text().replace("largest: m", "largest: 1"))
    done = invert(tmp_path, "own.yaml", "--allow-code")
    assert done.returncode == 2
    assert "objective.quantities.largest" in done.stderr


FAULTS = [
    ("0.5", "of type float", "growth, largest"),
    ("None", "of type NoneType", "growth, largest"),
    ("{'growth': 1.0}", "{'growth': 1.0}", "growth, largest"),
    ("{'growth': 1.0, 'largest': 1.0, 'more': 2.0}", "'more'", "growth, largest"),
    ("{'growth': float('nan'), 'largest': 1.0}", "nan as growth", "finite"),
    ("{'growth': 1.0, 'largest': 1e300}", "1e+300 as largest", "finite"),
    ("{'growth': 1.0, 'largest': {'a': 2.0}}", "{'a': 2.0} as largest", "of type dict"),
    ("{'growth': '1', 'largest': 1.0}", "'1' as growth", "of type str"),
    ("{'growth': True, 'largest': 1.0}", "True as growth", "of type bool"),
    ("[('growth', 1.0), ('largest', 1.0)]", "of type list", "growth, largest"),
]


@pytest.mark.parametrize(("returned", "said", "allowed"), FAULTS)
def test_what_is_no_such_mapping_fails_the_sample_with_its_text(tmp_path, returned, said, allowed):
    source = f"""
seen = []
def of_sample(sample):
    seen.append(0)
    return {returned} if len(seen) == 2 else {{'growth': 1.0, 'largest': 2.0}}
def value(means): return means['growth'] + means['largest']
"""
    path = write_quantities(tmp_path, source)
    batch = simulated(load_campaign(path, allow_code=True))
    rows = batch.results
    assert rows["state"].tolist() == [COMPLETED, FAILED, COMPLETED]
    assert rows["reason"].tolist() == [0, FailureReason.EXCEPTION, 0]
    assert rows["objective"].tolist() == [3.0, 0.0, 3.0]
    assert rows["largest"].tolist() == [2.0, 0.0, 2.0]
    [failure] = batch.failures
    text = failure["text"].decode()
    assert said in text
    assert allowed in text


def with_value(value):
    return f"""
def of_sample(sample): return {{'growth': sample.mean_radius_ratio, 'largest': 2.0}}
def value(means): {value}
"""


@pytest.mark.parametrize("value", ["return nothing", "return means['other']", "return 'one'"])
def test_a_faulty_function_of_means_fails_samples_and_ends_the_run(tmp_path, value):
    write_quantities(tmp_path, with_value(value), max_failures=3)
    done = invert(tmp_path, "own.yaml", "--allow-code")
    assert done.returncode == 1
    assert "samples failed with errors" in done.stderr
    assert "shape.py" in done.stderr or "must be a number" in done.stderr
    assert state(tmp_path / "own.h5")[0] == "failed"


@pytest.mark.parametrize("value", ["return 1.0 / (means['largest'] - 2.0)", "return float('inf')"])
def test_means_of_which_there_is_no_objective_make_strings_rank_last(tmp_path, value):
    path = write_quantities(tmp_path, with_value(value))
    rows = simulated(load_campaign(path, allow_code=True)).results
    assert rows["state"].tolist() == [COMPLETED] * 3
    assert np.isnan(rows["objective"]).all()
    done = invert(tmp_path, "own.yaml", "--allow-code")
    assert done.returncode == 1
    assert "no string has a result" in done.stderr
    assert np.isinf(read_campaign(tmp_path / "own.h5").result_rows()["objective"]).all()
    report = CliRunner().invoke(main, ["report", str(tmp_path / "own.h5")])
    assert "shape:value" in report.output
    assert "Traceback" not in report.output


def test_a_check_that_may_run_the_code_shows_what_it_makes_of_a_sample(agglom):
    done = agglom("check", "own.yaml", "--allow-code", "--json")
    found = json.loads(done.stdout)
    assert list(found["function_quantities"]) == COLUMNS
    assert found["function_value"] > 0.0
    text = agglom("check", "own.yaml").stdout
    assert "largest (m)" in text


@pytest.mark.plain
def test_the_function_sees_the_radii_that_grains_begin_with(tmp_path):
    source = """
import numpy as np
def of_sample(sample):
    first = sample.initial_radii
    assert first.shape == (30,) and not first.flags.writeable
    assert (np.diff(first) <= 0.0).all()
    volume = float((sample.radii ** 3).sum() / (first ** 3).sum())
    return {'growth': float(first.std()), 'largest': volume}
def value(means): return means['largest']
"""
    path = write_quantities(tmp_path, source)
    equal = path.read_text().replace("particles: 100", "particles: 30")
    path.write_text(equal)
    rows = simulated(load_campaign(path, allow_code=True)).results
    assert rows["growth"].tolist() == [0.0] * 3
    assert rows["largest"] == pytest.approx(1.0, rel=1e-9)
    sizes = "particles: 30\n  sizes: {law: lognormal, spread: 1.3}"
    path.write_text(equal.replace("particles: 30", sizes))
    rows = simulated(load_campaign(path, allow_code=True)).results
    assert rows["state"].tolist() == [COMPLETED] * 3
    assert (rows["growth"] > 0.1).all()
    assert rows["largest"] == pytest.approx(1.0, rel=1e-9)
    outcome = simulate(load_campaign(path, allow_code=True), {}, 1)
    assert outcome.quantities["growth"] == rows["growth"][1]


def test_rules_and_races_take_the_objective_of_means(tmp_path):
    write_quantities(tmp_path, max_samples=30)
    path = tmp_path / "own.yaml"
    text = path.read_text()
    assert "tolerance: 0.03" in text
    path.write_text(text.replace("  tolerance: 0.03", "  tolerance: 0.02\n  racing: {first: 5}", 1))
    finish(tmp_path, "own.yaml", "--allow-code")
    data, campaign = read_campaign(tmp_path / "own.h5"), load_campaign(path, allow_code=True)
    results = data.result_rows()
    assert len(set(results["samples_used"].tolist())) > 1
    ended = results[results["hit_maximum"] == 0]
    for result in ended:
        rows = data.sample_rows(int(result["string"]))[: result["samples_used"]]
        value, error = campaign.objective.of_rows(rows)
        assert (value, error) == (result["objective"], result["standard_error"])
    # A race ends strings that have as many samples as others of its round, 5 times a power of 2.
    raced = np.isin(ended["samples_used"], [5, 10, 20])
    half = [t_95(int(n) - 1) for n in ended["samples_used"]] * ended["standard_error"]
    assert (half[~raced] <= 0.02).all()
