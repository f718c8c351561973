"""Runs that keep particles of samples: all of them, the right ones, and nothing else changes."""

import shutil

import h5py
import numpy as np
import pytest
from campaign_runs import (
    assert_same,
    assert_sound,
    decisions,
    finish,
    inject,
    injected,
    invert,
    state,
)
from once import made_once, shared_folder
from particle_runs import (
    BOTH,
    COUNT,
    FRAMES,
    assert_particles_are_those_of_the_samples,
    pairs_of,
    pictures_wanted,
    write_bulk_campaign,
)

from agglom_mpi.analysis.completeness import lacks_rows
from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.storage.reader import read_campaign

TWO = {"generations": 2, "max_samples": 6}

KILLED_BY_THE_FIRST_PICTURES = """
import os
import signal
from agglom_mpi.runtime.post_stages import FrameStage

hang = FrameStage.store

def last_act(self, rows):
    hang(self, rows)
    os.kill(os.getpid(), signal.SIGKILL)

FrameStage.store = last_act
"""

STOPPED_BEFORE_PICTURES = """
import signal
from agglom_mpi.runtime.post_stages import FrameStage

prepare = FrameStage.open

def stopped(self):
    signal.raise_signal(signal.SIGTERM)
    return prepare(self)

FrameStage.open = stopped
"""

PICTURES_RAISE = """
import agglom_mpi.runtime.task_runner as simulator

simulate_scene, raised = simulator.simulate_scene, []

def camera_shy(scene, random, abort, frames=None):
    if frames is not None and not abort[0] and not raised:
        raised.append(True)
        raise ArithmeticError("injected")
    return simulate_scene(scene, random, abort, frames)

simulator.simulate_scene = camera_shy
"""


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Return a folder with a campaign that keeps particles, one that does not, and their files."""

    def make(folder):
        write_bulk_campaign(folder / "kept.yaml", **TWO)
        write_bulk_campaign(folder / "bare.yaml", "", **TWO)
        for name in ("kept", "bare"):
            finish(folder, f"{name}.yaml", "-q")

    return made_once(shared_folder(tmp_path_factory) / "kept", make)


@pytest.fixture
def path(kept, tmp_path):
    """Return a copy of the file with particles, beside its campaign."""
    shutil.copy(kept / "kept.yaml", tmp_path)
    return shutil.copy(kept / "kept.h5", tmp_path / "kept.h5")


def test_every_row_is_what_the_campaign_computes_for_everybody(kept):
    finals, framed = assert_particles_are_those_of_the_samples(kept / "kept.h5", kept / "kept.yaml")
    rows = read_campaign(kept / "kept.h5").all_sample_rows()
    assert finals == pairs_of(rows)
    assert len(set(rows["particles"])) > 10, "rows of very different lengths"
    assert framed == pictures_wanted(kept / "kept.h5")
    assert f"{len(rows)} final states and {6 * COUNT} frames are valid" in assert_sound(
        kept / "kept.h5"
    )


def test_what_is_kept_decides_nothing(kept):
    assert_same(kept / "kept.h5", decisions(kept / "bare.h5"))
    file = open_campaign(kept / "bare.h5")
    assert (file.final_particles(0, 0), file.framed(), file.frames(0, 0)) == (None, [], None)


def test_a_finished_campaign_with_its_pictures_has_nothing_to_do(path):
    done = finish(path.parent, "kept.yaml")
    assert "finished already: nothing to do" in done.stderr
    assert len(read_campaign(path).legs()) == 1


@pytest.mark.parametrize(
    ("code", "act", "left"),
    [
        pytest.param(-9, KILLED_BY_THE_FIRST_PICTURES, 1, marks=pytest.mark.slow),
        (75, STOPPED_BEFORE_PICTURES, 0),
    ],
)
def test_a_run_that_ends_before_its_pictures_takes_them_when_run_again(
    kept, tmp_path, code, act, left
):
    shutil.copy(kept / "kept.yaml", tmp_path)
    path = tmp_path / "kept.h5"
    if code == 75:
        with injected(act, "agglom_mpi.runtime.post_stages.FrameStage.open"):
            done = invert(tmp_path, "kept.yaml")
    else:
        done = invert(tmp_path, "kept.yaml", inject=inject(tmp_path / "inject", act))
    assert done.returncode == code, done.stderr
    assert len(open_campaign(path).framed()) == left
    assert state(path)[0] == "stopped"
    done = finish(tmp_path, "kept.yaml")
    assert "finished already" not in done.stderr
    assert f"taking pictures of {6 - left} samples, {COUNT} of each" in done.stderr
    assert_same(path, decisions(kept / "bare.h5"))
    finals, framed = assert_particles_are_those_of_the_samples(path, tmp_path / "kept.yaml")
    assert finals == pairs_of(read_campaign(path).all_sample_rows())
    assert framed == pictures_wanted(path)
    assert read_campaign(path).legs()["samples"][-1] == 0
    assert "finished already" in finish(tmp_path, "kept.yaml").stderr
    assert_sound(path)


def test_a_torn_picture_is_taken_again(path):
    import h5py

    with h5py.File(path, "r+") as file:
        row = file["frames"][7]
        row["time"] += 1.0
        file["frames"][7] = row
    text, code = check_file(str(path))
    assert code == 1
    assert "a resume would take again frames in rows 7" in text
    assert (
        f"taking pictures of 1 sample, {COUNT} of each" in finish(path.parent, "kept.yaml").stderr
    )
    _, framed = assert_particles_are_those_of_the_samples(path, path.parent / "kept.yaml")
    assert framed == pictures_wanted(path)
    assert_sound(path)


def test_more_generations_bring_pictures_of_the_new_best(path):
    before = open_campaign(path).framed()
    finish(path.parent, "kept.yaml", "--generations", "4")
    finals, framed = assert_particles_are_those_of_the_samples(path, path.parent / "kept.yaml")
    assert framed == pictures_wanted(path) != before
    assert finals == pairs_of(read_campaign(path).all_sample_rows())
    assert_sound(path)


def test_a_file_without_particles_gets_them_from_now_on(kept, tmp_path):
    path = shutil.copy(kept / "bare.h5", tmp_path / "kept.h5")
    campaign = shutil.copy(kept / "kept.yaml", tmp_path)
    before = pairs_of(read_campaign(path).all_sample_rows())
    finish(tmp_path, "kept.yaml")
    assert_same(path, decisions(kept / "bare.h5"))
    finals, framed = assert_particles_are_those_of_the_samples(path, campaign)
    assert (finals, framed) == ([], pictures_wanted(path))
    finish(tmp_path, "kept.yaml", "--generations", "3")
    finals, framed = assert_particles_are_those_of_the_samples(path, campaign)
    later = set(pairs_of(read_campaign(path).all_sample_rows())) - set(before)
    assert set(finals) == later != set()
    assert framed == pictures_wanted(path)
    assert_sound(path)


def test_what_is_no_longer_asked_for_stays_and_nothing_is_added(path, kept):
    before = [pairs_of(read_campaign(path).all_sample_rows()), open_campaign(path).framed()]
    campaign = write_bulk_campaign(path.parent / "kept.yaml", "", **TWO)
    assert "finished already" in finish(path.parent, "kept.yaml").stderr
    finish(path.parent, "kept.yaml", "--generations", "3")
    assert len(read_campaign(path).all_sample_rows()) > len(before[0])
    assert list(assert_particles_are_those_of_the_samples(path, campaign)) == before
    assert_sound(path)


@pytest.mark.parametrize(("output", "which"), [("final_particles: true", 0), (FRAMES, 1)])
def test_one_goes_without_the_other(kept, tmp_path, output, which):
    campaign = write_bulk_campaign(tmp_path / "one.yaml", output, **TWO)
    finish(tmp_path, "one.yaml")
    path = tmp_path / "one.h5"
    found = assert_particles_are_those_of_the_samples(path, campaign)
    wanted = [pairs_of(read_campaign(path).all_sample_rows()), pictures_wanted(path)]
    assert found[which] == wanted[which]
    assert found[1 - which] == []
    assert_same(path, decisions(kept / "bare.h5"))
    assert_sound(path)


def test_fewer_strings_than_asked_for_are_all_there_are(tmp_path):
    many = "frames: {count: 2, strings: 1000000000, samples: 1000000000}"
    tiny = {"generations": 1, "max_samples": 3, "population": 4, "parents": 2}
    write_bulk_campaign(tmp_path / "all.yaml", many, **tiny)
    text = (tmp_path / "all.yaml").read_text()
    (tmp_path / "all.yaml").write_text(
        text.replace("tolerance: 0.03", "tolerance: 0.03\n  min_samples: 3")
    )
    finish(tmp_path, "all.yaml")
    path = tmp_path / "all.h5"
    assert open_campaign(path).framed() == pictures_wanted(path, 4, 3)
    assert read_campaign(path).attributes["frames"] == 4 * 3 * 2


def test_an_exception_in_a_picture_is_stored_and_the_next_run_tries_again(path, tmp_path):
    write_bulk_campaign(path.parent / "kept.yaml", BOTH.replace("count: 5", "count: 4"), **TWO)
    with injected(PICTURES_RAISE, "agglom_mpi.runtime.task_runner.simulate_scene"):
        done = finish(path.parent, "kept.yaml")
    assert "ArithmeticError: injected" in done.stderr
    file = read_campaign(path)
    [failure] = file.failures()
    wanted = pictures_wanted(path)
    assert pairs_of(file.failures()) == wanted[:1]
    assert failure["text"].endswith(b"ArithmeticError: injected\n")
    assert file.particles.framed() == wanted[1:]
    assert "taking pictures of 1 sample, 4 of each" in finish(path.parent, "kept.yaml").stderr
    assert file.particles.framed() == wanted
    assert {len(file.particles.frames(*pair).times) for pair in wanted} == {4}
    assert len(file.failures()) == 1


@pytest.mark.parametrize("table", ["frames", "final_particles"])
def test_particles_that_a_finished_file_lacks_are_missed(path, table):
    assert check_file(path)[1] == 0
    with h5py.File(path, "r+") as file:
        final = np.flatnonzero(file[f"{table}_done"][:])
        file[f"{table}_done"][final[-COUNT:] if table == "frames" else final[-1:]] = 0
    text, code = check_file(path)
    assert code == 1
    assert f"{table}: " in text
    assert lacks_rows(read_campaign(path)) == (table == "frames")
