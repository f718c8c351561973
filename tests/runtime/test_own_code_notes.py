"""Code of the user's that ends its process: its sample is found, and left out as failed."""

from types import SimpleNamespace

import numpy as np
import pytest
from campaign_runs import assert_sound, finish, invert
from user_function_runs import write_own

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import FAILED, FailureReason
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.own_code_notes import OwnCodeNotes, ended_samples, notes_left
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.storage.lock import CampaignLock
from agglom_mpi.storage.reader import read_campaign

CRASHING = """
import os
import signal

def worth(sample):
    if {condition}:
        {fault}
    return float(sample.mean_radius_ratio)
"""
KILLS_ITSELF = "os.kill(os.getpid(), signal.SIGKILL)"
CRASHES = "import ctypes; ctypes.string_at(0)"


def write(folder, fault="pass", values=()):
    """Write a campaign of one generation whose function has a fault at some mean radii."""
    folder.mkdir(exist_ok=True)
    condition = f"sample.mean_radius_ratio in {tuple(values)}"
    source = CRASHING.format(fault=fault, condition=condition)
    return write_own(folder, source, generations=1, max_samples=6)


def samples(path):
    """Return state, reason and objective of the samples of a file, by string and number."""
    rows = read_campaign(path).all_sample_rows()
    columns = rows[["string", "sample", "state", "reason", "objective"]].tolist()
    return {(string, sample): found for string, sample, *found in columns}


@pytest.fixture(scope="module")
def faultless(tmp_path_factory):
    """Return the samples of a run without a fault."""
    folder = tmp_path_factory.mktemp("own")
    write(folder)
    finish(folder, "own.yaml", "--allow-code")
    return samples(folder / "own.h5")


@pytest.mark.slow
@pytest.mark.parametrize("fault", [KILLS_ITSELF, CRASHES])
def test_a_sample_that_ends_its_process_is_as_one_that_raises(tmp_path, faultless, fault):
    """Each start finds the one that has ended the start before; the others have all their bits."""
    wrong = [(0, 1), (2, 3)]
    values = [faultless[key][2] for key in wrong]
    write(tmp_path / "raises", "raise ArithmeticError", values)
    invert(tmp_path / "raises", "own.yaml", "--allow-code")
    expected = samples(tmp_path / "raises" / "own.h5")
    assert [expected[key][:2] for key in wrong] == [[FAILED, FailureReason.EXCEPTION]] * 2
    write(tmp_path / "crashes", fault, values)
    runs = [
        invert(tmp_path / "crashes", "own.yaml", "--allow-code", alone=True)
        for _ in range(1 + len(wrong))
    ]
    assert [done.returncode < 0 for done in runs] == [True, True, False]
    for done in runs[1:]:
        [line] = [line for line in done.stderr.splitlines() if "ended its process" in line]
        assert "shape.py" in line
        assert "signal SIG" in line
    path = tmp_path / "crashes" / "own.h5"
    assert samples(path) == expected
    assert sorted(read_campaign(path).failures()[["string", "sample"]].tolist()) == wrong
    assert_sound(path)


def test_only_samples_that_end_a_process_of_their_own_are_found(tmp_path, faultless):
    """Those that were under way when somebody else ended the run are not among them."""
    ends = [faultless[0, 1][2], faultless[0, 2][2]]
    path = write(tmp_path, KILLS_ITSELF, ends)
    folder = tmp_path / "own.h5"
    assert invert(tmp_path, "own.yaml", "--allow-code", alone=True).returncode < 0
    experiment = InversionExperiment(load_campaign(path, allow_code=True))
    file = SimpleNamespace(
        all_sample_rows=lambda: np.zeros(1, [("string", "i8"), ("sample", "i8")]),
        fresh_keys=np.array([(0, 1)]),
        parameters=read_campaign(folder).parameters,
    )
    noted = [(0, k) for k in range(4)] + [(77, 0)]
    ended = ended_samples(experiment, file, noted, StopRequest())
    killers = [k for k in (2, 3) if faultless[0, k][2] in ends]
    assert [each[:2] for each in ended] == [(0, k) for k in killers]
    stopped = StopRequest()
    stopped.request("for a test")
    assert list(ended_samples(experiment, file, noted, stopped)) == []
    unread = None  # a start with nothing to try reads no samples
    assert list(ended_samples(experiment, unread, [], StopRequest())) == []


def test_the_last_two_notes_of_each_rank_stay_until_the_lock_is_taken(tmp_path):
    path = tmp_path / "c.h5"
    assert notes_left(path) == []
    with CampaignLock(path) as lock:
        ranks = [OwnCodeNotes(path, rank) for rank in range(3)]
        for k in range(4):
            ranks[2].begin(5, k, 1)
        ranks[0].begin(1, 2, 3)
        assert notes_left(path) == [(1, 2), (1, 3), (1, 4), (5, 2), (5, 3)]
        text = lock.lock_path.read_bytes()[:4096].rstrip(b"\0").decode()
        assert text.startswith("process ")
    with CampaignLock(path):
        assert notes_left(path) == []


def test_a_rank_that_does_not_see_the_lock_file_notes_nothing(tmp_path):
    OwnCodeNotes(tmp_path / "nowhere" / "c.h5", 1).begin(1, 2, 3)
    assert notes_left(tmp_path / "nowhere" / "c.h5") == []
