"""The same command again, another one, or two at once."""

import hashlib
import shutil

import h5py
import pytest
from campaign_runs import (
    SMALL,
    assert_same,
    decisions,
    finish,
    invert,
    state,
    write_campaign,
)

from agglom_mpi.runtime.provenance import leg_start
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.writer import CampaignWriter


def fingerprint(path):
    return hashlib.sha256(path.read_bytes()).hexdigest(), path.stat().st_mtime_ns


@pytest.fixture
def copy(undisturbed, tmp_path):
    """Return a folder with a small campaign and its file, which may be changed."""
    shutil.copytree(undisturbed, tmp_path / "copy")
    return tmp_path / "copy"


def refused(folder, *arguments):
    """Standard error of a run that must not touch the file."""
    files = {path: fingerprint(path) for path in folder.iterdir() if path.suffix == ".h5"}
    done = invert(folder, *arguments)
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert files == {path: fingerprint(path) for path in folder.iterdir() if path.suffix == ".h5"}
    return done.stderr


def test_a_finished_campaign_is_not_run_again(copy):
    before = (copy / "small.h5").read_bytes()
    done = finish(copy, "small.yaml")
    said = [line for line in done.stderr.splitlines() if not line.startswith("warning: ")]
    assert said == ["small.h5 is finished already: nothing to do"]
    assert "finished: all 3 generations are done" in done.stdout
    assert (copy / "small.h5").read_bytes() == before


def test_more_generations_continue_and_equal_a_longer_run(copy):
    finish(copy, "small.yaml", "--generations", "4")
    finish(copy, "small.yaml", "--generations", "4", "-o", "straight.h5")
    assert_same(copy / "small.h5", decisions(copy / "straight.h5"))
    file = read_campaign(copy / "small.h5")
    assert len(file.generation_rows()) == 4
    assert len(file.legs()) == 2
    assert state(file.path) == ("finished", "all 4 generations are done")
    again = finish(copy, "small.yaml")
    assert "finished already" in again.stderr


def test_a_file_that_is_no_campaign_is_left_alone(copy):
    (copy / "notes.h5").write_text("my notes, not a database\n")
    with h5py.File(copy / "data.h5", "w") as file:
        file["x"] = [1.0]
    assert "notes.h5: not an HDF5 file" in refused(copy, "small.yaml", "-o", "notes.h5")
    assert "not an agglom_mpi campaign" in refused(copy, "small.yaml", "-o", "data.h5")


def test_the_file_of_another_campaign_is_refused_with_the_difference(copy):
    write_campaign(copy / "other.yaml", **SMALL | {"max_samples": 20, "seed": 2})
    message = refused(copy, "other.yaml", "-o", "small.h5")
    assert "small.h5: belongs to another campaign" in message
    assert "ensemble.max_samples: 30 in the file, 20 now" in message
    assert "seed: 1 in the file, 2 now" in message
    assert message.count(" in the file, ") == 2


@pytest.mark.parametrize(
    ("output", "words"), [("no/where.h5", "directory no does not exist"), (".", "is a directory")]
)
def test_an_output_that_cannot_be_is_refused(copy, output, words):
    assert words in refused(copy, "small.yaml", "-o", output)
    assert not (copy / "no").exists()


def test_changed_sources_are_refused_unless_accepted(copy):
    with CampaignWriter(copy / "small.h5") as writer:
        writer.log.begin_leg(**leg_start(1, "") | {"sources_sha256": "0" * 64})
    more = ("small.yaml", "--generations", "4")
    message = refused(copy, *more)
    assert "was computed by other simulation sources" in message
    assert "--accept-code-change" in message
    assert len(message.splitlines()) == 1
    finish(copy, *more, "--accept-code-change")
    file = read_campaign(copy / "small.h5")
    assert len(file.generation_rows()) == 4
    sources = file.legs()["sources_sha256"].tolist()
    assert sources[0] == sources[2] != sources[1] == b"0" * 64
    assert "nothing to do" in finish(copy, *more).stderr  # accepted once is enough


def test_a_missing_campaign_is_refused(tmp_path):
    assert refused(tmp_path, "nothing.yaml") == "nothing.yaml: no such file\n"
    assert list(tmp_path.iterdir()) == []
