"""Runs with components of one's own: copies of the package's decide as these do, to the bit."""

import hashlib
import json

import numpy as np
import pytest
from campaign_runs import (
    assert_same,
    assert_sound,
    decisions,
    finish,
    invert,
)
from click.testing import CliRunner
from once import made_once, shared_folder
from own_components import (
    ALL,
    DECIDING,
    NAMES_OF_ALL,
    NUMBERS_OF_COPIES,
    SEARCHED_SIZES,
    SIZES,
    write_copies,
)

from agglom_mpi import load_campaign, open_campaign
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.warm_start import warm_start
from agglom_mpi.cli import main
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.declaration.reading import own_names
from agglom_mpi.errors import CodeNotAllowedError
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.schema import parameters_of
from agglom_mpi.verbs.estimate import estimate
from agglom_mpi.verbs.simulate import simulate

NAMES = tuple(f"mine.py:{ALL[key].__name__}" for key in DECIDING)
"""What has to be compiled is copied in the slow tier alone, and in plain Python: a copy of a law is
a kind of scene of its own."""


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """Return a folder with files of a campaign and of its copy with components of its own."""

    def make(folder):
        write_copies(folder, "own", DECIDING, **NUMBERS_OF_COPIES)
        finish(folder, "own.yaml", "--allow-code")

    return made_once(shared_folder(tmp_path_factory) / "own-deciders", make)


@pytest.fixture
def moved(own, tmp_path, monkeypatch):
    """Return a folder with the file alone, and a function that runs `agglom` there."""
    (tmp_path / "own.h5").write_bytes((own / "own.h5").read_bytes())
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(main, [str(each) for each in arguments])


def test_copies_of_components_decide_as_the_package_s_do_to_the_bit(own, tmp_path):
    write_copies(tmp_path, "own", copied=(), **NUMBERS_OF_COPIES)
    finish(tmp_path, "own.yaml")
    assert_same(own / "own.h5", decisions(tmp_path / "own.h5"))
    assert_sound(own / "own.h5")
    assert not [name for name in read_campaign(tmp_path / "own.h5").attributes if "own" in name]


@pytest.mark.slow(guard="simulation/test_copied_laws.py")
def test_copies_of_laws_decide_as_the_package_s_do_to_the_bit(own, tmp_path):
    write_copies(tmp_path, "own", **NUMBERS_OF_COPIES)
    finish(tmp_path, "own.yaml", "--allow-code")
    assert_same(tmp_path / "own.h5", decisions(own / "own.h5"))
    assert sorted(own_names(read_campaign(tmp_path / "own.h5").identity).values()) == (
        sorted(NAMES_OF_ALL)
    )


def test_the_file_has_the_bytes_of_the_module_of_each_component(own):
    stored = read_campaign(own / "own.h5")
    [module] = json.loads(stored.attributes["own_modules"])
    assert module["source"] == (own / "mine.py").read_text()
    sections = own_names(stored.identity)
    assert sorted(sections.values()) == sorted(NAMES)
    digests = {stored.identity[f"{section}.source_sha256"] for section in sections}
    assert digests == {module["sha256"]}
    assert "own_components" not in stored.attributes


@pytest.mark.parametrize(
    "arguments",
    [
        ("report", "own.h5"),
        ("report", "own.h5", "--json"),
        ("export", "own.h5", "--csv", "tables"),
        ("export", "own.h5", "--compact", "small.h5"),
        ("check", "own.h5"),
    ],
)
def test_without_its_code_a_file_is_its_tables_and_says_so(moved, arguments, monkeypatch):
    monkeypatch.setattr("agglom_mpi.declaration.own_modules.executed", refuse)
    done = moved(*arguments)
    assert done.exit_code == 0, done.output
    [line] = [line for line in done.output.splitlines() if "--allow-code" in line]
    assert "own.h5 has code of its own" in line
    assert all(name in line for name in NAMES)


@pytest.mark.parametrize(
    "arguments",
    [
        ("report", "own.h5", "own.h5"),
        ("report", "own.h5", "--sensitivity"),
        ("report", "own.h5", "--posterior"),
        ("report", "own.h5", "--feasible-set"),
        ("report", "own.h5", "--follow"),
        ("report", "own.h5", "--out", "page"),
        ("export", "own.h5", "--paraview", "best.vtkhdf"),
        ("export", "own.h5", "--json", "set.json"),
        ("pareto", "own.h5", "own.h5", "--x", "mean_radius_ratio"),
        ("simulate", "own.h5", "--string", "1"),
    ],
)
def test_what_needs_its_code_ends_with_one_message(moved, arguments, monkeypatch, tmp_path):
    monkeypatch.setattr("agglom_mpi.declaration.own_modules.executed", refuse)
    done = moved(*arguments)
    assert done.exit_code == 2, done.output
    assert isinstance(done.exception, SystemExit)
    [line] = [line for line in done.stderr.splitlines() if "--allow-code" in line]
    assert "own.h5 has code of its own" in line
    assert [path.name for path in tmp_path.iterdir()] == ["own.h5"]


def test_the_report_without_code_has_the_best_string_of_the_last_generation(moved, tmp_path):
    found = json.loads(moved("report", "own.h5", "--json").stdout)
    stored = read_campaign(tmp_path / "own.h5")
    last = stored.generation_rows()[-1]
    assert (found["state"], found["generations"]) == ("finished", 2)
    assert (found["best_string"], found["objective"]) == (
        *(last["best_string"], pytest.approx(last["best_objective"], rel=1e-12)),
    )
    speed = stored.values([last["best_string"]], "relative_speed")[0]
    assert found["relative_speed"] == pytest.approx(speed, rel=1e-12)


def test_a_file_of_an_earlier_version_is_read_and_checked(moved, tmp_path):
    import h5py

    with h5py.File(tmp_path / "own.h5", "r+") as file:
        described = json.dumps({name: {"summary": "text"} for name in NAMES})
        file.attrs["own_components"] = described
        both = file.attrs["own_modules"] + described
        file.attrs["own_sha256"] = hashlib.sha256(both.encode()).hexdigest()
        checksums = json.loads(file.attrs["checksums"])
        changed = [name for name in checksums if name not in ("own_sha256", "own_components")]
        file.attrs["checksums"] = json.dumps({name: checksums[name] for name in changed})
    for allowed in ([], ["--allow-code"]):
        done = moved("check", "own.h5", *allowed)
        assert done.exit_code == 0, done.output
    with h5py.File(tmp_path / "own.h5", "r+") as file:
        file.attrs["own_components"] = described.replace("text", "other")
    done = moved("check", "own.h5")
    assert done.exit_code == 1
    assert "own_components" in done.output


def refuse(own):
    """Stand for the execution of a module."""
    raise AssertionError(f"{own.file} is executed")


def started_from(own, folder, copied):
    """Return a campaign with some components of its own that begins with strings of `own.h5`."""
    path = write_copies(folder, "next", copied, **NUMBERS_OF_COPIES)
    start = f"start: {{file: {own / 'own.h5'}, strings: 2}}"
    path.write_text(path.read_text().replace("search: {", f"search: {{{start}, "))
    return path


@pytest.mark.parametrize("edit", ["", "# another version\n"])
def test_leave_for_own_code_is_no_leave_for_that_of_a_start_file(own, tmp_path, edit, monkeypatch):
    path = started_from(own, tmp_path, ("objective",) if edit else ())
    with (tmp_path / "mine.py").open("a") as file:
        file.write(edit)
    campaign = load_campaign(path, allow_code=bool(edit))
    monkeypatch.setattr("agglom_mpi.declaration.own_modules.executed", refuse)
    with pytest.raises(CampaignError, match=r"own\.h5: needs code of one's own"):
        warm_start(campaign)


def test_a_module_that_a_campaign_and_its_start_file_name_is_executed(own, tmp_path):
    campaign = load_campaign(started_from(own, tmp_path, ("objective",)), allow_code=True)
    stored = read_campaign(own / "own.h5", allow_code=True)
    best = parameters_of(stored.string_rows()[rank_strings(stored).order[:2]])
    assert np.array_equal(warm_start(campaign).strings, best, equal_nan=True)


def test_a_check_verifies_rows_and_leaves_out_the_decisions(moved):
    text = moved("check", "own.h5").stdout
    assert text.startswith("own.h5: sound")
    assert "digests: 2 of 2 generations verified" in text
    assert "replay: left out; " in text
    text = moved("check", "own.h5", "--allow-code").stdout
    assert "replay: the samples lead again to 6 of 6 strings, 6 of 6 results and 2 of 2" in text


@pytest.mark.parametrize("name", ["own_modules", "own_sha256"])
@pytest.mark.parametrize("absent", [True, False])
def test_an_altered_record_of_components_is_a_fault_also_where_nothing_needs_it(
    moved, name, absent, tmp_path
):
    import h5py

    with h5py.File(tmp_path / "own.h5", "r+") as file:
        text = file.attrs.pop(name) if absent else file.attrs[name]
        if not absent:
            file.attrs[name] = text[:-9] + ("a" if text[-9] != "a" else "b") + text[-8:]
    done = moved("check", "own.h5")
    assert done.exit_code == 1
    assert name in done.output


@pytest.mark.parametrize("text", ["3", '{"a": 1}', '[{"file": "mine.py"}]', "[null]"])
def test_sources_that_are_none_are_one_message(moved, text, tmp_path):
    import h5py

    with h5py.File(tmp_path / "own.h5", "r+") as file:
        file.attrs["own_modules"] = text
    for command in ("report", "check", "simulate"):
        string = ["--string", 1, "--sample", 1] if command == "simulate" else []
        done = moved(command, "own.h5", "--allow-code", *string)
        assert isinstance(done.exception, SystemExit | None)
        assert "damaged" in done.output or command == "report"


@pytest.mark.parametrize("allowed", [[], ["--allow-code"]])
def test_a_damaged_record_is_a_fault_whatever_its_digest_is(moved, allowed, tmp_path):
    import h5py

    with h5py.File(tmp_path / "own.h5", "r+") as file:
        file.attrs["own_modules"] = "{"
        file.attrs["own_sha256"] = hashlib.sha256(b"{").hexdigest()
    done = moved("check", "own.h5", *allowed)
    assert isinstance(done.exception, SystemExit | None)
    assert done.exit_code == 1
    assert "damaged" in done.output


def test_a_module_with_another_digest_is_not_executed(moved, tmp_path):
    import h5py

    with h5py.File(tmp_path / "own.h5", "r+") as file:
        text = file.attrs["own_modules"]
        file.attrs["own_modules"] = text.replace("import math", "1 / 0 #", 1)
    done = moved("check", "own.h5", "--allow-code")
    assert done.exit_code == 1
    assert "ZeroDivisionError" not in done.output
    assert "no source with the same digest" in done.output


@pytest.fixture(scope="module")
def sizes(tmp_path_factory):
    """Return the file of a campaign that searches a number of its own law of sizes."""

    def make(folder):
        (folder / "flat.py").write_text(SIZES)
        (folder / "sizes.yaml").write_text(SEARCHED_SIZES)
        finish(folder, "sizes.yaml", "--allow-code")

    return made_once(shared_folder(tmp_path_factory) / "own-sizes", make) / "sizes.h5"


@pytest.mark.parametrize("arguments", [("check",), ("report",), ("export", "--csv", "tables")])
def test_a_searched_number_of_an_own_law_of_sizes_needs_no_code_to_be_read(
    sizes, tmp_path, monkeypatch, arguments
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.h5").write_bytes(sizes.read_bytes())
    done = CliRunner().invoke(main, [arguments[0], "own.h5", *arguments[1:]])
    assert done.exit_code == 0, done.output
    assert "own.h5 has code of its own (flat.py:" in done.output
    assert read_campaign(tmp_path / "own.h5").variables.further_names == (
        "sizes.ratio",
        "volume_fraction",
    )


def test_the_estimates_are_those_of_the_code_where_it_may_run(own, moved, tmp_path):
    with pytest.raises(CodeNotAllowedError):
        _ = open_campaign(tmp_path / "own.h5").estimates
    assert len(open_campaign(tmp_path / "own.h5").strings) == 6
    assert len(open_campaign(tmp_path / "own.h5", allow_code=True).estimates) == 2
    assert moved("report", "own.h5", "--allow-code").exit_code == 0


def test_a_recorded_sample_is_simulated_again_with_leave_alone(moved):
    done = moved("simulate", "own.h5", "--string", 1, "--sample", 1)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "--allow-code" in done.stderr
    done = moved("simulate", "own.h5", "--string", 1, "--sample", 1, "--allow-code")
    assert done.exit_code == 0
    assert "identical to the recorded sample" in done.stdout


def test_a_resume_with_the_same_module_ends_as_one_run_does(own, tmp_path):
    write_copies(tmp_path, "own", DECIDING, **NUMBERS_OF_COPIES)
    finish(tmp_path, "own.yaml", "--allow-code", "--generations", "1")
    assert len(read_campaign(tmp_path / "own.h5").generation_rows()) == 1
    finish(tmp_path, "own.yaml", "--allow-code")
    assert_same(tmp_path / "own.h5", decisions(own / "own.h5"))


def test_an_edited_module_is_refused_by_its_name(own, tmp_path):
    write_copies(tmp_path, "own", DECIDING, **NUMBERS_OF_COPIES)
    (tmp_path / "own.h5").write_bytes((own / "own.h5").read_bytes())
    (tmp_path / "mine.py").write_text((tmp_path / "mine.py").read_text() + "# edited\n")
    before = (tmp_path / "own.h5").read_bytes()
    done = invert(tmp_path, "own.yaml", "--allow-code")
    assert done.returncode == 2
    lines = [line for line in done.stderr.splitlines() if "source_sha256" in line]
    assert len(lines) == len(NAMES)
    assert all("mine.py was edited" in line for line in lines)
    assert (tmp_path / "own.h5").read_bytes() == before


def test_without_leave_a_run_is_refused(tmp_path):
    write_copies(tmp_path, "own", DECIDING, **NUMBERS_OF_COPIES)
    done = invert(tmp_path, "own.yaml")
    assert done.returncode == 2
    assert done.stderr.count("\n") == len(NAMES)
    assert "own.yaml:" in done.stderr
    assert not (tmp_path / "own.h5").exists()


FAULTS = [
    ("class Genetic(", "build", "1 / 0", "ZeroDivisionError"),
    ("class StandardError(", "holds", "raise SystemExit(0)", "raised SystemExit"),
    pytest.param(
        *("class StandardError(", "holds", "import os; os._exit(0)", "os._exit would end a rank"),
        marks=pytest.mark.slow(guard="runtime/test_user_function_runs.py"),
    ),
    ("class GrowthTarget(", "deviation", "raise KeyError('x')", "KeyError"),
]


@pytest.mark.parametrize(("kind", "method", "fault", "said"), FAULTS)
def test_a_component_that_fails_ends_the_run_in_one_line(tmp_path, kind, method, fault, said):
    write_copies(tmp_path, "own", DECIDING, **NUMBERS_OF_COPIES)
    source = (tmp_path / "mine.py").read_text()
    at = source.index(f"    def {method}(", source.index(kind))
    line = source.index('"""', source.index('"""', at) + 3) + 3
    (tmp_path / "mine.py").write_text(f"{source[:line]}\n        {fault}{source[line:]}")
    done = invert(tmp_path, "own.yaml", "--allow-code", alone="_exit" in fault)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "own.h5").exists()


def test_the_public_interface_simulates_and_estimates(own):
    campaign = load_campaign(own / "own.yaml", allow_code=True)
    stored = read_campaign(own / "own.h5")
    first = stored.parameters[0]
    outcome = simulate(campaign, first, 0)
    row = stored.sample_rows(0)[0]
    assert outcome.mean_radius_ratio == row["mean_radius_ratio"]
    assert outcome.objective == abs(outcome.mean_radius_ratio / 2.0 - 1.0)
    assert np.isfinite(estimate(campaign, first, samples=3).mean_radius_ratio.value)
    assert len(ALL) == len(set(ALL.values())) >= 9
