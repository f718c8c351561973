"""Time to a first sample with nothing compiled yet, and the cache, of installations in turn.

Run with `pytest tests/benchmarks/bench_compilation.py -m benchmark -s`, or as a program with the
Python interpreters of the installations to compare as arguments.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from bench_event import JOBS, ROWS, print_row

from agglom_mpi.variables import TEN

REPEATS = 3
SAMPLE = """
import sys
from agglom_mpi import load_campaign
campaign = load_campaign(sys.argv[1])
campaign.simulate(eval(sys.argv[2]), 0, "event")
"""
FRAMES = SAMPLE.replace('"event"', '"event", frames=3')
WIDTHS = (22, 36, 10, 10, 18, 14, 12)
TITLES = ("job", "installation", "cold, s", "again", "then frames", "cold frames", "cache, MiB")


def seconds_of(python, program, folder, job, row):
    """Seconds of a process from its start to its end."""
    values = dict(zip(TEN.names, row, strict=False))
    words = [python, "-c", program, str(JOBS / f"{job}.yaml"), repr(values)]
    begin = time.perf_counter()
    variables = os.environ | {"NUMBA_CACHE_DIR": folder}
    subprocess.run(words, env=variables, cwd=folder, check=True)  # imports nothing from here
    return time.perf_counter() - begin


def measured(python, job, row):
    """Seconds cold, again, and of frames then and cold; MiB of the cache with all of them."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as other:
        times = [seconds_of(python, text, folder, job, row) for text in (SAMPLE, SAMPLE, FRAMES)]
        times.append(seconds_of(python, FRAMES, other, job, row))
        files = [path.stat().st_size for path in Path(folder).rglob("*") if path.is_file()]
    return [*times, sum(files) / 2**20]


def compare(pythons):
    print(f"\na process from its start to its end, medians of {REPEATS}, in turn")
    print_row(WIDTHS, TITLES)
    for job, (row, _) in ROWS.items():
        runs = [[measured(python, job, row) for python in pythons] for _ in range(REPEATS)]
        for python, columns in zip(pythons, zip(*runs, strict=True), strict=True):
            middle = [statistics.median(column) for column in zip(*columns, strict=True)]
            print_row(WIDTHS, (job, python[-34:], *(f"{value:.1f}" for value in middle)))


@pytest.mark.benchmark
def test_print_the_time_to_a_first_sample():
    compare([sys.executable])


if __name__ == "__main__":
    compare(sys.argv[1:] or [sys.executable])
