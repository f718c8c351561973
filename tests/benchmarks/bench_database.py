"""What the campaign file costs: share of the time, bytes per sample, and a reader beside a run.

`pytest tests/benchmarks/bench_database.py -m benchmark -s` (some minutes), with either build of
h5py. The campaign is [A]'s, its samples take half a millisecond.
"""

import statistics
import subprocess
import sys
import time
from pathlib import Path

import h5py
import pytest
from campaign_runs import environment, finish, start

from agglom_mpi.storage.reader import read_campaign

JOB = Path(__file__).parents[2] / "jobs" / "accretion_2003.yaml"
GENERATIONS = "8"
RUNS = 5
POLLER = """
import sys, time
from agglom_mpi.analysis.summary import summary_table
from agglom_mpi.storage.reader import read_campaign

path, looks, seconds = sys.argv[1], 0, 0.0
try:
    while True:
        begin = time.monotonic()
        try:
            summary_table(read_campaign(path))
        except FileNotFoundError:
            pass
        else:
            looks += 1
            seconds += time.monotonic() - begin
        time.sleep(max(0.0, begin + 0.1 - time.monotonic()))
except KeyboardInterrupt:
    print(looks, seconds / max(1, looks))
"""

pytestmark = pytest.mark.benchmark


def run(folder, database=None, ranks=None):
    """Run the campaign afresh; its file's leg, and the file."""
    path = folder / "a.h5"
    path.unlink(missing_ok=True)
    words = [] if database is None else ["--database", database]
    options = {"ranks": ranks, "alone": True}
    finish(folder, JOB, "-o", path, "--generations", GENERATIONS, "-q", *words, **options)
    return read_campaign(path).legs()[-1], path


def rate(leg):
    return leg["samples"] / (leg["stopped"] - leg["started"])


@pytest.fixture
def folder(tmp_path):
    run(tmp_path)
    return tmp_path


def test_print_the_share_of_time_in_the_database(folder):
    able = h5py.get_config().mpi
    databases = ["gathered", "parallel"] if able else ["gathered"]
    print(f"\nHDF5 {h5py.version.hdf5_version}, 2 ranks, medians of {RUNS} runs")
    print(f"{'database':<10}{'samples/s':>10}{'share of time':>15}{'us per sample':>15}")
    legs = {database: [] for database in databases}
    for _ in range(RUNS):
        for database in databases:
            legs[database].append(run(folder, database, ranks=2)[0])
    for database in databases:
        shares = [
            leg["database_seconds"] / leg["ranks"] / (leg["stopped"] - leg["started"])
            for leg in legs[database]
        ]
        each = [1e6 * leg["database_seconds"] / leg["samples"] for leg in legs[database]]
        speed = statistics.median(map(rate, legs[database]))
        share, micro = statistics.median(shares), statistics.median(each)
        print(f"{database:<10}{speed:>10.0f}{share:>15.2%}{micro:>15.1f}")


def test_print_the_bytes_of_a_sample(folder):
    leg, path = run(folder)
    with h5py.File(path, "r") as file:
        row = file["samples"].dtype.itemsize
        logical = sum(dataset.nbytes for dataset in file.values())
    size, count = path.stat(), leg["samples"]
    allocated = size.st_blocks * 512
    print(f"\n{count} samples of {row} bytes; {allocated / count:.0f} allocated for each")
    print(f"{logical / 1e6:.1f} MB logical, {allocated / 1e6:.1f} MB allocated")


def test_print_what_a_reader_ten_times_a_second_costs(folder):
    ratios = []
    print()
    for _ in range(RUNS):
        alone = rate(run(folder)[0])
        (folder / "a.h5").unlink()
        poller = subprocess.Popen(
            [sys.executable, "-c", POLLER, str(folder / "a.h5")],
            env=environment(),
            stdout=subprocess.PIPE,
            text=True,
        )
        process = start(folder, JOB, "-o", folder / "a.h5", "--generations", GENERATIONS, "-q")
        process.communicate(timeout=120)
        time.sleep(0.2)
        poller.send_signal(2)
        looks, each = poller.communicate(timeout=30)[0].split()
        watched = rate(read_campaign(folder / "a.h5").legs()[-1])
        ratios.append(watched / alone)
        print(f"{alone:.0f} samples/s alone, {watched:.0f} watched, {looks} looks of {each:.6} s")
    print(f"watched over alone: {statistics.median(ratios):.3f}")
