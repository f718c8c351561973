"""What the farm makes of two cores: throughput, dispatch of tasks that do nothing, waiting.

`pytest tests/benchmarks/bench_farm.py -m benchmark -s` (some twenty minutes on a quiet machine).
"""

import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from campaign_runs import _BIN, environment, finish, start

from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.storage.reader import read_campaign

JOBS = Path(__file__).parents[2] / "jobs"
NOOP = Path(__file__).parent / "noop_farm.py"
RUNS = 5

pytestmark = pytest.mark.benchmark


class Leg(NamedTuple):
    """A whole run: samples used and fresh, seconds of these, and of the run."""

    samples: int
    simulated: float
    seconds: float


def leg_of(path):
    [leg] = read_campaign(path).legs()
    samples = open_campaign(path).samples
    kept = samples.loc[samples["used"] | samples["fresh"], "seconds"]
    return Leg(len(kept), kept.sum(), leg["stopped"] - leg["started"])


def words(job, path, generations):
    path.unlink(missing_ok=True)
    return JOBS / f"{job}.yaml", "-o", path, "--generations", generations, "-q"


@pytest.mark.parametrize(
    ("job", "generations"), [("accretion_2003", "16"), ("agglomeration_2004", "60")]
)
def test_two_ranks_against_one_process_and_against_two(tmp_path, job, generations):
    """Single processes have one thread that simulates; their samples are compiled before.

    The other one, that serves it, has the other core to itself where there is one process. All use
    the same samples. A speedup is twice the share of their time in which two ranks simulate what is
    used, by that of one, by how much longer a sample takes while both cores work. The share is the
    farm's; the rest is the machine's, and that of main threads which take turns with those that
    simulate.
    """
    finish(tmp_path, *words(job, tmp_path / "warm.h5", "1"))
    one, two, both = [], [], []
    for _ in range(RUNS):
        finish(tmp_path, *words(job, tmp_path / "1.h5", generations), alone=True)
        one.append(leg_of(tmp_path / "1.h5"))
        finish(tmp_path, *words(job, tmp_path / "2.h5", generations), ranks=2)
        two.append(leg_of(tmp_path / "2.h5"))
        paths = [tmp_path / f"{name}.h5" for name in "ab"]
        started = [start(tmp_path, *words(job, path, generations), inject=None) for path in paths]
        assert [process.wait() for process in started] == [0, 0]
        both.append([leg_of(path) for path in paths])
        assert len({one[-1].samples, two[-1].samples, *(leg.samples for leg in both[-1])}) == 1
    speed_of_one = np.array([1.0 / leg.seconds for leg in one])
    speed_of_two = np.array([1.0 / leg.seconds for leg in two])
    joint = np.array([2.0 / statistics.mean(leg.seconds for leg in legs) for legs in both])
    alone = np.array([leg.simulated for leg in one])
    kept = np.array([[leg.simulated for leg in legs] for legs in both])
    whole = np.array([[leg.seconds for leg in legs] for legs in both])
    together = np.array([leg.simulated for leg in two])
    figures = {
        "two ranks by one process": speed_of_two / speed_of_one,
        "two processes by one": joint / speed_of_one,
        "two ranks by two processes": speed_of_two / joint,
        "simulates what is used: one process": alone * speed_of_one,
        "simulates what is used: two ranks": together * speed_of_two / 2.0,
        "simulates what is used: two processes": kept / whole,
        "a sample by one of one process: two ranks": together / alone,
        "a sample by one of one process: two processes": kept / alone[:, None],
    }
    print(f"\n{job}, {one[0].samples} samples; median (lowest to highest) of {RUNS}:")
    for name, values in figures.items():
        print(f"{name:47s}{np.median(values):.3f} ({values.min():.3f} to {values.max():.3f})")


def test_busy_share_agrees_with_the_operating_system(tmp_path):
    job = "accretion_2003"
    finish(tmp_path, *words(job, tmp_path / "warm.h5", "1"), ranks=2)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    finish(tmp_path, JOBS / f"{job}.yaml", "-o", "warm.h5", "--generations", "1", "-q", ranks=2)
    idle = resource.getrusage(resource.RUSAGE_CHILDREN)
    finish(tmp_path, *words(job, tmp_path / "x.h5", "12"), ranks=2)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = [
        b.ru_utime + b.ru_stime - a.ru_utime - a.ru_stime
        for a, b in ((before, idle), (idle, after))
    ]
    [leg] = read_campaign(tmp_path / "x.h5").legs()
    whole = 2 * (leg["stopped"] - leg["started"])
    print(
        f"\nbusy share by the program {leg['busy_seconds'] / whole:.3f}; processor time by the "
        f"operating system, without the start, {(spent[1] - spent[0]) / whole:.3f} of two cores"
    )


def noop(*arguments):
    command = [_BIN / "mpirun", "-n", "2", sys.executable, NOOP, *arguments]
    runs = []
    for _ in range(RUNS):
        done = subprocess.run(
            [*map(str, command)], env=environment(), capture_output=True, text=True, check=True
        )
        runs.append(float(done.stdout.split()[-1]))
        time.sleep(0.2)
    return statistics.median(runs)


def test_tasks_that_do_nothing():
    """One master, one worker; the peer hands out plain Python functions."""
    print("\ntasks/s          one in a message   1024")
    print(f"this farm        {noop('farm', 1, 3):16.0f}   {noop('farm', 1024, 3):.0f}")
    print(
        f"mpi4py.futures   {noop('futures', 1, 5000):16.0f}   {noop('futures', 1024, 200_000):.0f}"
    )


def test_a_rank_without_work_takes_little_of_its_core():
    print(f"\na waiting rank takes {noop('wait', 0, 5):.4f} of a core")
