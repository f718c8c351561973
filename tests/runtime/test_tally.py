import numpy as np
import pytest

from agglom_mpi.outcome import COMPLETED, FAILED
from agglom_mpi.runtime import tally
from agglom_mpi.runtime.experiment import StageProgress
from agglom_mpi.storage.reader import read_campaign

STAGE = StageProgress(1, 2, "generations")


@pytest.fixture
def clock(monkeypatch):
    """Return a clock that is set by hand, in s."""
    time = [100.0]
    monkeypatch.setattr(tally.time, "monotonic", lambda: time[0])
    return time


def test_ranks_are_busy_for_the_share_of_the_time_in_which_they_simulate(finished, clock):
    counted = tally.RunTally(read_campaign(finished))
    stored = counted.progress(2, 0, STAGE).samples
    rows = np.zeros(3, [("seconds", "f8"), ("cpu_seconds", "f8"), ("state", "u1")])
    rows["seconds"], rows["cpu_seconds"], rows["state"] = 1.0, 0.5, COMPLETED
    rows["state"][0] = FAILED
    clock[0] += 10.0
    counted.count(rows)
    found = counted.progress(ranks=2, in_flight=4, stage=STAGE)
    assert (found.busy, found.rate) == (pytest.approx(3.0 / 20.0), pytest.approx(0.3))
    assert (found.samples - stored, found.failed, found.in_flight) == (3, 1, 4)
    assert counted.cpu_seconds == pytest.approx(1.5)


def test_a_leg_lasts_at_least_as_long_as_its_generations_and_ends_before_now(finished):
    data = read_campaign(finished)
    [leg] = data.legs()
    assert leg["stopped"] - leg["started"] >= data.generation_rows()["seconds"].max()
    assert leg["stopped"] <= finished.stat().st_mtime + 1.0  # s, what a file system may round
