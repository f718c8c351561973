"""Runs that estimate their best strings in several control volumes."""

import json

import h5py
import numpy as np
import pytest
from campaign_runs import (
    TINY,
    assert_same,
    assert_sound,
    decisions,
    finish,
    injected,
    state,
    write_campaign,
)
from click.testing import CliRunner
from once import made_once, shared_folder
from reestimation_runs import best_by_search, fresh_rows
from volume_runs import volume_bytes, volume_counts

from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.cli import main
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import COLUMNS
from agglom_mpi.scheduling.interface import volume_string
from agglom_mpi.statistics import mean_of
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.verbs.simulate import simulate

STRINGS, SAMPLES = 2, 8
ONE = f"{{strings: {STRINGS}, samples: {SAMPLES}}}"
THREE = f"{{strings: {STRINGS}, samples: {SAMPLES}, volumes: [1, 2, 4]}}"

SAMPLE_7_RAISES_IN_VOLUME_2 = """
import agglom_mpi.runtime.task_runner as simulator
from agglom_mpi.scheduling.interface import volume_string

do = simulator.SampleTask._simulate

def careless(self, sample, seconds):
    is_open = do(self, sample, seconds)
    if volume_string(self._string).volume == 2 and sample == 7:
        raise ArithmeticError("injected")
    return is_open

simulator.SampleTask._simulate, simulator.MAX_AT_ONCE = careless, 1
"""

SAMPLE_TASK = "agglom_mpi.runtime.task_runner.SampleTask._simulate"


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    """Return the folder of a finished campaign in three volumes, which tests only read."""

    def make(folder):
        write_campaign(folder / "three.yaml", **TINY, final=THREE)
        finish(folder, "three.yaml", "-q")

    return made_once(shared_folder(tmp_path_factory) / "volumes", make)


def test_each_volume_has_the_samples_that_the_campaign_simulates_there(three):
    file = read_campaign(three / "three.h5")
    campaign = load_campaign(str(three / "three.yaml"))
    best = sorted(best_by_search(three / "three.h5", STRINGS))
    first = campaign.ensemble.max_samples
    assert file.volumes == (2, 4)
    for volume in file.volumes:
        larger, rows = campaign.in_volume(volume), file.volume_rows(volume)
        wanted = [(string, first + k) for string in best for k in range(SAMPLES)]
        assert rows[["string", "sample"]].tolist() == wanted
        for row in rows:
            outcome = simulate(larger, file.parameters[int(row["string"])], int(row["sample"]))
            assert row["objective"] == outcome.objective
            for column in COLUMNS:
                assert row[column.name].tobytes() == outcome.record[column.name].tobytes()


def test_volumes_decide_nothing_and_change_no_other_table(three, tmp_path):
    write_campaign(tmp_path / "one.yaml", **TINY, final=ONE)
    finish(tmp_path, "one.yaml", "-q")
    assert_same(three / "three.h5", decisions(tmp_path / "one.h5"))
    assert volume_bytes(three / "three.h5")[1] == volume_bytes(tmp_path / "one.h5")[1]
    with h5py.File(tmp_path / "one.h5") as one, h5py.File(three / "three.h5") as other:
        more = {f"samples_volume_{v}{end}" for v in (2, 4) for end in ("", "_done")}
        assert set(other) - set(one) == more
        assert set(other.attrs) - set(one.attrs) == {"volumes"}
        assert one["samples"].dtype == other["samples_volume_2"].dtype


def test_volumes_and_samples_that_are_asked_for_later_are_added(three, tmp_path):
    path = tmp_path / "three.h5"
    for final in (
        "none",
        "{strings: 1, samples: 3, volumes: [1, 4]}",
        THREE,
    ):
        write_campaign(tmp_path / "three.yaml", **TINY, final=final)
        finish(tmp_path, "three.yaml", "-q")
        assert_sound(path)
    assert volume_bytes(path) == volume_bytes(three / "three.h5")
    assert_same(path, decisions(three / "three.h5"))


def test_a_finished_file_says_which_volumes_there_are_and_is_not_continued(three):
    assert state(three / "three.h5")[1].endswith(", volumes 1 2 4")
    assert "finished already" in finish(three, "three.yaml").stderr
    said = assert_sound(three / "three.h5")
    assert f"volume 4: {STRINGS * SAMPLES} samples" in said


def test_an_absent_sample_of_a_volume_is_found_and_made_again(three, tmp_path):
    write_campaign(tmp_path / "three.yaml", **TINY, final=THREE)
    path = tmp_path / "three.h5"
    path.write_bytes((three / "three.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        places = np.flatnonzero(file["samples_volume_4_done"][:])
        file["samples_volume_4_done"][places[3]] = 0
        row = file["samples_volume_2"][0]
        row["mean_radius_ratio"] += 1.0
        file["samples_volume_2"][0] = row
        first = np.flatnonzero(file["samples_volume_2_done"][:])[0]
        damaged = file["samples_volume_2"][first]
        damaged["mean_radius_ratio"] += 1.0
        file["samples_volume_2"][first] = damaged
    text, code = check_file(str(path))
    assert code == 1
    assert "samples_volume_4: sample" in text
    assert "samples_volume_2: sample" in text
    finish(tmp_path, "three.yaml", "-q")
    assert_sound(path)
    assert volume_bytes(path) == volume_bytes(three / "three.h5")


def test_an_exception_in_a_volume_is_one_failed_sample_of_that_volume(three, tmp_path):
    write_campaign(tmp_path / "three.yaml", **TINY, final=THREE)
    with injected(SAMPLE_7_RAISES_IN_VOLUME_2, SAMPLE_TASK):
        done = finish(tmp_path, "three.yaml")
    file = read_campaign(tmp_path / "three.h5")
    failed = {volume: file.volume_rows(volume)["state"] == 2 for volume in file.volumes}
    assert failed[2].sum() == STRINGS
    assert not failed[4].any()
    assert (file.all_sample_rows()["state"] == 1).all()
    assert len(file.failures()) == STRINGS
    assert_sound(tmp_path / "three.h5")
    means = {
        each.volume: each for each in open_campaign(tmp_path / "three.h5").volumes.itertuples()
    }
    assert 2 not in means  # more than a tenth of its samples failed
    first = file.failures()[0]
    assert volume_string(int(first["string"])).volume == 2
    assert f"string {volume_string(int(first['string'])).text} sample 7" in done.stderr


def test_reports_show_the_limit_beside_the_estimate(three):
    path = three / "three.h5"
    [entry, *_] = json.loads(CliRunner().invoke(main, ["report", str(path), "--json"]).stdout)[
        "best"
    ]
    size, string = entry["finite_size"], entry["string"]
    file = read_campaign(path)
    rows = {1: file.fresh_samples} | {v: file.volume_rows(v) for v in file.volumes}
    means = {
        v: mean_of(each["mean_radius_ratio"][each["string"] == string]) for v, each in rows.items()
    }
    assert [each["grains"] for each in size["volumes"]] == [100, 200, 400]
    for each in size["volumes"]:
        assert each["mean_radius_ratio"] == pytest.approx(means[each["volume"]].value, rel=1e-12)
        assert each["standard_error"] == pytest.approx(means[each["volume"]].error, rel=1e-12)
    assert size["shift"] == pytest.approx(means[1].value - size["limit"], abs=1e-12)
    assert size["limit_objective"] == pytest.approx(abs(size["limit"] / 2.0 - 1.0), abs=1e-12)
    assert size["limit_objective_standard_error"] == pytest.approx(
        size["limit_standard_error"] / 2.0, rel=1e-9
    )
    opened = open_campaign(path)
    assert opened.limits["limit"].iloc[0] == size["limit"]
    assert len(opened.volumes) == 3 * STRINGS
    assert opened.volumes.attrs["units"]["cpu_seconds"] == "s"
    text = CliRunner().invoke(main, ["report", str(path)]).stdout
    assert text.count("finite size of #") == STRINGS


def test_an_objective_that_contains_n_keeps_the_campaigns_own(tmp_path):
    path = write_campaign(tmp_path / "most.yaml", **TINY, final=THREE)
    text = path.read_text().replace("{law: growth_target, ratio: 2}", "maximum_growth")
    path.write_text(text)
    finish(tmp_path, "most.yaml", "-q")
    opened, file = open_campaign(tmp_path / "most.h5"), read_campaign(tmp_path / "most.h5")
    largest = 100 ** (1 / 3)
    for row in opened.volumes.itertuples():
        samples = fresh_rows(file.path) if row.volume == 1 else file.volume_rows(row.volume)
        ratios = samples["mean_radius_ratio"][samples["string"] == row.string]
        # Samples in larger volumes may outgrow all grains of the campaign's own.
        assert row.objective == pytest.approx(np.mean(abs(1.0 - ratios / largest)), rel=1e-9)
    for row in opened.limits.itertuples():
        # Of grains that all merge too few are left for a limit.
        assert np.isfinite(row.limit) == (row.why_no_limit == "")
        assert row.limit_objective == pytest.approx(
            abs(1.0 - row.limit / largest), rel=1e-9, nan_ok=True
        )


def test_tables_and_copies_have_the_volumes(three, tmp_path):
    source, copy, folder = three / "three.h5", tmp_path / "copy.h5", tmp_path / "tables"
    words = ["export", str(source), "--compact", str(copy), "--csv", str(folder)]
    assert CliRunner().invoke(main, words).exit_code == 0
    assert volume_bytes(copy) == volume_bytes(source)
    assert_sound(copy)
    assert len((folder / "volumes.csv").read_text().splitlines()) == 1 + 3 * STRINGS
    assert len((folder / "limits.csv").read_text().splitlines()) == 1 + STRINGS


def test_a_campaign_without_volumes_has_no_tables_of_them(shared_campaign):
    path = shared_campaign("tiny") / "tiny.h5"
    assert len(open_campaign(path).volumes) == 0
    assert len(open_campaign(path).limits) == 0
    assert volume_counts(path) == {}
    said = json.loads(CliRunner().invoke(main, ["report", str(path), "--json"]).stdout)
    assert "finite_size" not in said["best"][0]
    assert "samples_in_larger_volumes" not in said
