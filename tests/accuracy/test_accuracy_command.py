"""`agglom accuracy` from the command line: plain, with MPI, again, and with bad input."""

import importlib.util
import shutil
import subprocess

import h5py
import numpy as np
import pytest
from agglom_here import agglom_here
from campaign_runs import QUICKSTART, environment, need_mpirun
from experiment_runs import write_experiments
from measured_runs import write_measured
from processes import HANG

from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.outcome import COLUMNS
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.table import Table


def run(folder, *arguments, ranks=None):
    if ranks is None:
        return agglom_here(folder, "accuracy", *arguments)
    return subprocess.run(
        ["mpirun", "-n", str(ranks), "agglom", "accuracy", *map(str, arguments)],
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
    )


@pytest.fixture(scope="module")
def folder(shared_campaign, tmp_path_factory):
    """Return a folder with a copy of a small campaign and of its file."""
    folder = tmp_path_factory.mktemp("study")
    for name in ("small.yaml", "small.h5"):
        shutil.copy(shared_campaign("small") / name, folder)
    return folder


@pytest.fixture(scope="module")
def studied(folder):
    """Return that folder with the quick study of both."""
    done = run(folder, "small.yaml", "--quick", "--samples", 12, "--history", "small.h5", "-o", "a")
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    return folder


def columns(file):
    rows = read_campaign(file).all_sample_rows()
    return {
        name: rows[name].tobytes()
        for name in ("string", "sample", "objective", *(column.name for column in COLUMNS))
    }


@pytest.mark.slow
def test_the_report_has_every_section_with_its_figures_and_tables(studied):
    text = (studied / "a" / "report.md").read_text()
    for title in (
        "Time integration",
        "Ensemble",
        "Control volume",
        "Inversion",
    ):
        assert f"### {title}" in text
    assert text.startswith("# Accuracy: Quickstart")
    assert "`agglom accuracy small.yaml --out a --samples 12 --history small.h5 --quick`" in text
    for line in text.splitlines():
        if line.startswith("!["):
            picture = line.rpartition("(")[2].rstrip(")")
            assert (studied / "a" / picture).stat().st_size > 1000
            assert (studied / "a" / picture).with_suffix(".svg").exists()
    assert {"time_integration", "box_particles", "inversion", "inversion_history"} <= {
        path.stem for path in (studied / "a").glob("*.csv")
    }


@pytest.mark.parametrize("command", ["report", "simulate --string 0", "accuracy -o b --history"])
@pytest.mark.slow
def test_a_study_has_no_best_strings_to_be_shown_or_replayed(studied, command):
    words = [*command.split(), "a/samples.h5"]
    words += ["small.yaml"] if "accuracy" in command else []
    done = agglom_here(studied, *words)
    expected = "a/samples.h5: holds the samples of an accuracy study, not an inversion's\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", expected)


@pytest.mark.slow
def test_a_study_is_exported_like_a_campaign(studied, tmp_path):
    words = ["export", "a/samples.h5", "--compact", tmp_path / "c.h5", "--csv", tmp_path]
    done = agglom_here(studied, *words)
    assert (done.returncode, done.stderr) == (0, "")
    original, copy = read_campaign(studied / "a" / "samples.h5"), read_campaign(tmp_path / "c.h5")
    assert copy.attributes["purpose"] == "accuracy study"
    assert copy.all_sample_rows().tobytes() == original.all_sample_rows().tobytes()
    assert copy.string_rows().tobytes() == original.string_rows().tobytes()
    lines = {path.stem: path.read_text().count("\n") - 1 for path in tmp_path.glob("*.csv")}
    assert lines["samples"] == len(original.all_sample_rows())
    assert lines["strings"] == len(original.string_rows())


@pytest.mark.slow
def test_the_samples_of_a_study_are_checked_but_for_the_search_that_there_was_not(studied):
    text, code = check_file(str(studied / "a" / "samples.h5"))
    assert code == 0, text
    assert "\n  digests: 1 of 1 generation verified\n" in text
    assert "\n  replay: left out; the strings of an accuracy study are not searched\n" in text
    assert text.endswith("\n  finished: all set-ups are measured")


@pytest.mark.slow
def test_a_forged_sample_of_a_study_is_found_by_its_digest(studied, tmp_path):
    path = tmp_path / "samples.h5"
    shutil.copy(studied / "a" / "samples.h5", path)
    with h5py.File(path, "r+") as file:
        table = Table(file, "samples", path)
        row = table.rows.read(1, 1)
        row["mean_radius_ratio"] *= 1.0 + 1e-12
        table.write(1, row)
    text, code = check_file(str(path))
    assert code == 1
    assert "generations: digest mismatch in 0:" in text


@pytest.mark.slow
def test_strings_are_estimated_again_on_samples_that_no_decision_has_seen(studied):
    history = read_campaign(studied / "small.h5")
    again = read_campaign(studied / "a" / "samples.h5")
    number = next(
        int(row["string"])
        for row in again.string_rows()
        if row["string"] == len(again.string_rows()) - 1
    )
    fresh = again.sample_rows(number)["mean_radius_ratio"]
    seen = history.all_sample_rows()["mean_radius_ratio"]
    assert len(fresh) == 12
    assert not np.isin(fresh, seen).any()


@pytest.mark.slow
def test_a_finished_study_only_writes_its_report_again(studied):
    report = studied / "a" / "report.md"
    samples = (studied / "a" / "samples.h5").read_bytes()
    report.unlink()
    arguments = ("small.yaml", "--quick", "--samples", 12, "--history", "small.h5", "-o", "a")
    done = run(studied, *arguments)
    assert done.returncode == 0, done.stderr
    assert "nothing to do" in done.stderr
    assert report.exists()
    assert (studied / "a" / "samples.h5").read_bytes() == samples


@pytest.mark.slow
def test_ranks_and_a_stop_in_between_change_no_sample(studied):
    need_mpirun()
    arguments = ("small.yaml", "--quick", "--samples", 12, "--history", "small.h5", "-o", "b")
    stopped = run(studied, *arguments, "--max-walltime", "0.01", ranks=2)
    assert stopped.returncode == 75, stopped.stderr
    assert not (studied / "b" / "report.md").exists()
    done = run(studied, *arguments, ranks=2)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("accuracy study of") == 1
    assert columns(studied / "b" / "samples.h5") == columns(studied / "a" / "samples.h5")
    assert (studied / "b" / "report.md").exists()


@pytest.mark.slow
def test_another_study_in_the_same_directory_is_refused(studied):
    done = run(studied, "small.yaml", "--quick", "--samples", 13, "-o", "a")
    assert done.returncode == 2
    assert "belongs to another" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.yaml", "-o", "x"], "nowhere.yaml: no such file"),
        (["small.yaml", "-o", "x", "--set", "density=heavy"], "density: is the text 'heavy'"),
        (["small.yaml", "-o", "x", "--history", "no.h5"], "no.h5: No such file or"),
        (["small.yaml", "-o", "small.h5"], "small.h5: File exists"),
        (["small.yaml", "-o", "x", "--set", "activation_energy=1e9"], "scene: "),
    ],
)
def test_bad_input_is_one_message_and_leaves_nothing(folder, arguments, message):
    done = run(folder, *arguments)
    assert done.returncode == 2, done.stderr
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (folder / "x").exists()


@pytest.mark.parametrize("mode", [[], ["--map", "collapse"]], ids=["study", "map"])
def test_what_no_time_steps_can_simulate_is_refused(tmp_path, mode):
    shutil.copy(QUICKSTART.parent / "extremes" / "sheared_slowly.yaml", tmp_path / "sheared.yaml")
    write_experiments(tmp_path)
    for name, field in (("sheared", "10: scene.escape: is 'shear'"), ("experiments", " SOURCE: ")):
        done = run(tmp_path, f"{name}.yaml", "--quick", *mode, "-o", "x")
        assert done.returncode == 2
        [message] = done.stderr.splitlines()
        assert message.startswith(f"{name}.yaml:{field}")
        assert not (tmp_path / "x").exists()


def test_without_matplotlib_it_says_what_to_install(folder, monkeypatch):
    find = importlib.util.find_spec
    without = lambda name, *rest: None if name == "matplotlib" else find(name, *rest)  # noqa: E731
    monkeypatch.setattr(importlib.util, "find_spec", without)
    done = run(folder, "small.yaml", "--quick", "-o", "x")
    assert done.returncode == 2
    [message] = done.stderr.splitlines()
    assert "matplotlib" in message
    assert "agglom_mpi[report]" in message


@pytest.mark.slow
def test_a_map_reproduces_its_failing_cells_and_goes_on_where_it_was_stopped(folder):
    arguments = ("small.yaml", "--quick", "--map", "collapse", "-o", "m")
    stopped = run(folder, *arguments, "--max-walltime", "0.01")
    assert stopped.returncode == 75, stopped.stderr
    assert not (folder / "m" / "report.md").exists()
    done = run(folder, *arguments)
    assert done.returncode == 0, done.stderr
    text = (folder / "m" / "report.md").read_text()
    cells = {path.stem for path in (folder / "m" / "cells").glob("*.yaml")}
    assert "collapse_event_engine" in cells
    assert all(f"m/cells/{name}.yaml" in text for name in cells)
    again = agglom_here(folder, "simulate", "m/cells/collapse_event_engine.yaml", "--samples", 4)
    assert "budget of steps or events exceeded" in again.stdout + again.stderr


@pytest.mark.slow
@pytest.mark.parametrize("mode", [[], ["--map", "collapse"]], ids=["study", "map"])
def test_the_scene_of_a_campaign_of_measured_data_is_studied(tmp_path, mode):
    write_measured(tmp_path)
    done = run(tmp_path, "measured.yaml", "--quick", *mode, "-o", "x")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "x" / "report.md").exists()


def test_an_unknown_plane_is_one_message(folder):
    done = run(folder, "small.yaml", "--map", "colapse", "-o", "x")
    assert done.returncode == 2
    assert "colapse" in done.stderr
    assert "collapse" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (folder / "x").exists()


def test_laws_alone_are_mapped_without_any_sample(folder):
    done = run(folder, "small.yaml", "--quick", "--map", "cooling", "-o", "laws")
    assert done.returncode == 0, done.stderr
    assert (folder / "laws" / "map_cooling.png").stat().st_size > 1000
    assert not list((folder / "laws").glob("*.h5"))
