"""What the farm makes of two cores: throughput, dispatch of tasks that do nothing, waiting.

`pytest tests/benchmarks/bench_farm.py -m benchmark -s` (some ten minutes on a quiet machine).
"""

import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

import pytest
from farm_runs import _BIN, environment, finish, start

from agglom_mpi.database.reader import open_campaign

JOBS = Path(__file__).parents[2] / "jobs"
NOOP = Path(__file__).parent / "noop_farm.py"
RUNS = 3

pytestmark = pytest.mark.benchmark


def used_per_second(path):
    """Samples that decisions used, per second of the leg."""
    file = open_campaign(path)
    [leg] = file.legs()
    return file.generation_rows()["samples_used"].max() / (leg["stopped"] - leg["started"])


def words(job, path, generations):
    path.unlink(missing_ok=True)
    return JOBS / f"{job}.yaml", "-o", path, "--generations", generations, "-q"


@pytest.mark.parametrize(
    ("job", "generations"), [("accretion_2003", "12"), ("agglomeration_2004", "20")]
)
def test_two_ranks_against_one_process_and_against_two(tmp_path, job, generations):
    """Single processes have one thread that simulates; their samples are compiled before."""
    finish(tmp_path, *words(job, tmp_path / "warm.h5", "1"))
    one, two, joint = [], [], []
    for _ in range(RUNS):
        finish(tmp_path, *words(job, tmp_path / "1.h5", generations))
        one.append(used_per_second(tmp_path / "1.h5"))
        finish(tmp_path, *words(job, tmp_path / "2.h5", generations), ranks=2)
        two.append(used_per_second(tmp_path / "2.h5"))
        paths = [tmp_path / f"{name}.h5" for name in "ab"]
        for process in [start(tmp_path, *words(job, path, generations)) for path in paths]:
            assert process.wait() == 0
        joint.append(sum(map(used_per_second, paths)))
    speedup = statistics.median(b / a for a, b in zip(one, two, strict=True))
    share = statistics.median(b / a for a, b in zip(joint, two, strict=True))
    cores = statistics.median(b / a for a, b in zip(one, joint, strict=True))
    print(
        f"\n{job}: one process {statistics.median(one):.0f} samples/s, two ranks "
        f"{statistics.median(two):.0f}; ratio {speedup:.3f}; two processes at once {cores:.3f}, "
        f"of which two ranks reach {share:.3f}"
    )


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
    [leg] = open_campaign(tmp_path / "x.h5").legs()
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
