"""Runs that estimate their best strings again: on the right samples, once, deciding nothing."""

import json
import shutil

import h5py
import pytest
from campaign_runs import (
    TINY,
    assert_same,
    assert_sound,
    decisions,
    finish,
    inject,
    injected,
    invert,
    state,
    write_campaign,
)
from click.testing import CliRunner
from once import made_once, shared_folder
from reestimation_runs import (
    assert_fresh_are_those_of_the_best,
    best_by_search,
    fresh_bytes,
    fresh_rows,
)

from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.cli import main
from agglom_mpi.formatting import value_with_error
from agglom_mpi.storage.attributes import write_checksums
from agglom_mpi.storage.reader import read_campaign

TWO = {"generations": 2, "max_samples": 12}
STRINGS, SAMPLES = 3, 8
FINAL = f"{{strings: {STRINGS}, samples: {SAMPLES}}}"

STOPPED_AT_ONCE = """
import signal
from agglom_mpi.runtime.post_stages import ReestimationStage

take = ReestimationStage.take

def stopped(self, rows):
    take(self, rows)
    signal.raise_signal(signal.SIGNAL)

ReestimationStage.take = stopped
"""

SAMPLE_13_RAISES = """
import agglom_mpi.runtime.task_runner as simulator

do = simulator.SampleTask._simulate

def careless(self, sample, seconds):
    is_open = do(self, sample, seconds)
    if sample == 13:
        raise ArithmeticError("injected")
    return is_open

simulator.SampleTask._simulate, simulator.MAX_AT_ONCE = careless, 1
"""
SAMPLE_TASK = "agglom_mpi.runtime.task_runner.SampleTask._simulate"


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """Return a folder with a campaign that estimates again, one that does not, and their files."""

    def make(folder):
        write_campaign(folder / "final.yaml", **TWO, final=FINAL)
        write_campaign(folder / "bare.yaml", **TWO)
        for name in ("final", "bare"):
            finish(folder, f"{name}.yaml", "-q")

    return made_once(shared_folder(tmp_path_factory) / "ended", make)


@pytest.fixture
def path(ended, tmp_path):
    """Return a copy of the file with estimates, beside its campaign."""
    shutil.copy(ended / "final.yaml", tmp_path)
    return shutil.copy(ended / "final.h5", tmp_path / "final.h5")


def test_fresh_samples_are_what_the_campaign_simulates_with_numbers_beyond_its_most(ended):
    path = ended / "final.h5"
    assert_fresh_are_those_of_the_best(path, ended / "final.yaml", STRINGS, SAMPLES)
    file = read_campaign(path)
    assert (file.fresh_from, file.max_samples) == (12, 20)
    assert f"used, {STRINGS * SAMPLES} fresh)" in assert_sound(path)


def test_estimating_again_decides_nothing_and_is_counted_apart(ended):
    assert_same(ended / "final.h5", decisions(ended / "bare.h5"))
    file, bare = (read_campaign(ended / name) for name in ("final.h5", "bare.h5"))
    assert bare.fresh_from == bare.max_samples == 12
    assert len(open_campaign(bare.path).estimates) == 0
    rows = file.all_sample_rows()
    assert file.legs()["samples"].tolist() == [len(rows)]
    searched = int((rows["sample"] < 12).sum())
    assert file.generation_rows()["samples_simulated"][-1] <= searched
    table = open_campaign(file.path).samples
    assert table["fresh"].sum() == STRINGS * SAMPLES
    assert not table["used"][table["fresh"]].any()
    assert table["used"].sum() == file.result_rows()["samples_used"].sum()


def test_a_finished_campaign_with_its_estimates_has_nothing_to_do(path):
    before = path.read_bytes()
    assert "finished already: nothing to do" in finish(path.parent, "final.yaml").stderr
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("code", "signal"), [pytest.param(-9, "SIGKILL", marks=pytest.mark.slow), (75, "SIGTERM")]
)
def test_a_run_that_ends_among_fresh_samples_goes_on_to_the_same_bytes(
    ended, tmp_path, code, signal
):
    shutil.copy(ended / "final.yaml", tmp_path)
    path, text = tmp_path / "final.h5", STOPPED_AT_ONCE.replace("SIGNAL", signal)
    if code == 75:
        with injected(text, "agglom_mpi.runtime.post_stages.ReestimationStage.take"):
            done = invert(tmp_path, "final.yaml")
    else:
        done = invert(tmp_path, "final.yaml", inject=inject(tmp_path / "inject", text))
    assert done.returncode == code, done.stderr
    assert len(fresh_rows(path)) < STRINGS * SAMPLES
    assert state(path)[0] == "stopped"
    assert_sound(path)
    done = finish(tmp_path, "final.yaml")
    left = STRINGS * SAMPLES - len(fresh_rows(path)) + read_campaign(path).legs()["samples"][-1]
    assert f"again, on {left} fresh sample" in done.stderr
    assert fresh_bytes(path) == fresh_bytes(ended / "final.h5")
    assert_same(path, decisions(ended / "bare.h5"))
    assert_sound(path)


def test_more_strings_are_estimated_and_those_there_are_stay(path):
    before = {row.tobytes() for row in fresh_rows(path)}
    write_campaign(path.parent / "final.yaml", **TWO, final="{strings: 5, samples: 8}")
    done = finish(path.parent, "final.yaml")
    assert "estimating 2 strings again, on 16 fresh samples" in done.stderr
    assert_fresh_are_those_of_the_best(path, path.parent / "final.yaml", 5, SAMPLES)
    assert before <= {row.tobytes() for row in fresh_rows(path)}
    assert read_campaign(path).legs()["samples"][-1] == 16
    assert_sound(path)


def test_fewer_strings_than_asked_for_are_all_there_are(tmp_path):
    write_campaign(tmp_path / "all.yaml", **TINY, final="{strings: 99, samples: 2}")
    finish(tmp_path, "all.yaml", "-q")
    assert_fresh_are_those_of_the_best(tmp_path / "all.h5", tmp_path / "all.yaml", 4, 2)


def test_more_samples_are_added_to_those_there_are(ended, path):
    write_campaign(path.parent / "final.yaml", **TWO, final="{strings: 4, samples: 20}")
    before = {row.tobytes() for row in fresh_rows(path)}
    done = finish(path.parent, "final.yaml")
    fresh = 4 * 20 - STRINGS * SAMPLES
    assert f"estimating 4 strings again, on {fresh} fresh samples" in done.stderr
    assert_fresh_are_those_of_the_best(path, path.parent / "final.yaml", 4, 20)
    assert before <= {row.tobytes() for row in fresh_rows(path)}
    assert read_campaign(path).legs()["samples"][-1] == fresh
    assert_same(path, decisions(ended / "final.h5"))
    assert_sound(path)


def test_fewer_generations_than_there_are_change_nothing_and_are_said(path):
    before = path.read_bytes()
    done = finish(path.parent, "final.yaml", "--generations", "1")
    assert "holds 2 generations already, more than the 1 asked for; they stay" in done.stderr
    assert "finished already: nothing to do" in done.stderr
    assert "finished: all 2 generations are done" in done.stdout
    assert path.read_bytes() == before


def test_another_title_is_said_not_to_be_the_files(path):
    text = (path.parent / "final.yaml").read_text()
    (path.parent / "final.yaml").write_text(text.replace("title: Quickstart", "title: Slowstart"))
    done = finish(path.parent, "final.yaml")
    assert "keeps the title 'Quickstart - double the mean grain size' that it" in done.stderr
    assert "it is now 'Slowstart - double the mean grain size', which" in done.stderr


def test_as_many_strings_are_listed_as_are_estimated_again(path):
    shown = CliRunner().invoke(main, ["report", str(path)]).stdout
    assert "#3" in shown
    assert "#4" not in shown


def test_more_generations_go_on_as_if_nothing_had_been_estimated(ended, path):
    shutil.copy(ended / "bare.yaml", path.parent)
    shutil.copy(ended / "bare.h5", path.parent)
    for name in ("final", "bare"):
        finish(path.parent, f"{name}.yaml", "-q", "--generations", "5")
    assert_same(path, decisions(path.parent / "bare.h5"))
    assert read_campaign(path).result_rows().tobytes() == (
        read_campaign(path.parent / "bare.h5").result_rows().tobytes()
    )
    best = set(best_by_search(path, STRINGS))
    assert best != set(best_by_search(ended / "final.h5", STRINGS))
    assert best <= set(open_campaign(path).estimates["string"])
    assert_sound(path)


def test_a_file_of_an_earlier_version_gets_room_for_estimates(ended, tmp_path):
    path = shutil.copy(ended / "bare.h5", tmp_path / "final.h5")
    shutil.copy(ended / "final.yaml", tmp_path)
    with h5py.File(path, "r+") as file:
        del file.attrs["fresh_from"]
        write_checksums(file)
    assert_sound(path)
    finish(tmp_path, "final.yaml", "-q")
    assert_fresh_are_those_of_the_best(path, tmp_path / "final.yaml", STRINGS, SAMPLES)
    assert fresh_bytes(path) == fresh_bytes(ended / "final.h5")
    assert_sound(path)


def test_a_fresh_sample_that_raises_is_left_out_and_counted(ended, tmp_path):
    write_campaign(tmp_path / "final.yaml", **TWO, final="{strings: 3, samples: 11}")
    with injected(SAMPLE_13_RAISES, SAMPLE_TASK):
        assert "ArithmeticError: injected" in finish(tmp_path, "final.yaml").stderr
    file = open_campaign(tmp_path / "final.h5")
    assert file.estimates["failed"].tolist() == [1] * STRINGS
    assert file.estimates["samples"].tolist() == [11] * STRINGS
    failures = read_campaign(file.path).failures()
    assert failures["sample"].tolist() == [13] * STRINGS
    for row in file.estimates.itertuples():
        kept = fresh_rows(tmp_path / "final.h5")
        kept = kept[(kept["string"] == row.string) & (kept["sample"] != 13)]
        assert row.objective == pytest.approx(abs(kept["mean_radius_ratio"].mean() / 2 - 1))
    assert_same(tmp_path / "final.h5", decisions(ended / "bare.h5"))
    assert "finished already" in finish(tmp_path, "final.yaml").stderr
    assert_sound(tmp_path / "final.h5")


def test_a_run_says_once_that_the_file_has_no_room_for_more_failures(tmp_path):
    write_campaign(tmp_path / "final.yaml", **TWO, final="{strings: 4, samples: 4}")
    full = "import agglom_mpi.storage.room as room\nroom.FAILURE_CAPACITY = 2\n"
    capacity = "agglom_mpi.storage.room.FAILURE_CAPACITY"
    with injected(SAMPLE_13_RAISES + full, SAMPLE_TASK, capacity):
        said = finish(tmp_path, "final.yaml").stderr
    assert said.count("ArithmeticError: injected") == 1
    assert said.count("failures; more texts are lost") == 1
    assert len(read_campaign(tmp_path / "final.h5").failures()) == 2
    rows = fresh_rows(tmp_path / "final.h5")
    assert (rows["state"] == 2).sum() == 4, "what failed is still in the samples"
    assert_sound(tmp_path / "final.h5")


def test_too_many_fresh_samples_that_raise_end_the_run(tmp_path):
    write_campaign(tmp_path / "final.yaml", **TWO, final=FINAL, max_failures=2)
    with injected(SAMPLE_13_RAISES, SAMPLE_TASK):
        done = invert(tmp_path, "final.yaml")
    assert done.returncode == 1, done.stderr
    assert state(tmp_path / "final.h5") == ("failed", "2 samples failed with errors")


def test_a_torn_fresh_sample_is_simulated_again(ended, path):
    string, sample = fresh_rows(path)[["string", "sample"]].tolist()[-1]
    place = string * 20 + sample
    with h5py.File(path, "r+") as file:
        row = file["samples"][place]
        row["mean_radius_ratio"] += 1.0
        file["samples"][place] = row
    assert "a resume would simulate again sample 19 of string" in check_file(str(path))[0]
    assert "on 1 fresh sample" in finish(path.parent, "final.yaml").stderr
    assert fresh_bytes(path) == fresh_bytes(ended / "final.h5")
    assert_sound(path)


def test_the_report_ranks_by_the_estimates(path):
    file = open_campaign(path)
    estimates = file.estimates
    assert estimates["objective"].is_monotonic_increasing
    assert file.best(5)["string"].tolist()[:STRINGS] == estimates["string"].tolist()
    assert file.best(5)["estimate"][:STRINGS].tolist() == estimates["objective"].tolist()
    assert file.best(5)["estimate"][STRINGS:].isna().all()
    text = CliRunner().invoke(main, ["report", str(path)]).stdout
    row = next(line for line in text.splitlines() if line.startswith("objective, re-estimate"))
    numbers = zip(estimates["objective"], estimates["standard_error"], strict=True)
    assert row.split()[2:] == " ".join(value_with_error(*each) for each in numbers).split()
    said = json.loads(CliRunner().invoke(main, ["report", str(path), "--json"]).stdout)
    assert [entry["string"] for entry in said["best"]] == file.best(6)["string"].tolist()
    assert said["samples_fresh"] == STRINGS * SAMPLES
    assert said["best"][0]["reestimate"]["upper"] == estimates["upper"][0]
    assert said["best"][STRINGS]["reestimate"] is None
    assert said["verdict"]["first"] == estimates["string"][0]


def test_a_recorded_fresh_sample_is_replayed(path):
    string, sample = fresh_rows(path)[["string", "sample"]].tolist()[-1]
    words = ["simulate", str(path), "--string", str(string), "--sample", str(sample)]
    done = CliRunner().invoke(main, words)
    assert "identical to the recorded sample" in done.stdout
