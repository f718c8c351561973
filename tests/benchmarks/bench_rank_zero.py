"""What samples, ranges and messages cost rank 0, of installations in turn, with instant workers.

Run with `pytest tests/benchmarks/bench_rank_zero.py -m benchmark -s`, or as a program with the
Python interpreters of the installations to compare as arguments, an older one first.
"""

import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from bench_event import JOBS, print_row

INSTANT = Path(__file__).parent / "instant_ranks.py"
REPEATS = 3
WORKERS = (1, 2, 8)
SECONDS = 4e-4
"""Stated time of a sample, s."""

CASES = {
    "[A], population 200": {"population": 200, "parents": 60, "generations": 6},
    "long ranges": {
        **{"population": 200, "parents": 60, "generations": 2},
        **{"tolerance": 1e-9, "max_samples": 2000},
    },
}
"""Changed numbers of [A]; with the second no rule holds, so that a message is one range."""

WIDTHS = (20, 8, 36, 12, 14, 14, 14, 12)
TITLES = (
    *("campaign", "workers", "installation", "samples/s", "us a sample", "us a message"),
    *("samples each", "ranges each"),
)


def campaign_text(changes):
    """Return [A] with other numbers and without a target."""
    text = re.sub(r"\n  target: .*", "", (JOBS / "accretion_2003.yaml").read_text())
    for name, value in changes.items():
        text = re.sub(rf"(\n  {name}: )\S+", rf"\g<1>{value}", text)
    return text


def measured(python, path, workers):
    """Samples/s, µs a sample and a message of rank 0, and samples and ranges of a message."""
    launcher = [Path(python).parent / "mpirun", "-n", str(workers + 1), python]
    quiet = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    command = [*launcher, INSTANT, path, str(SECONDS)]
    done = subprocess.run(command, env=quiet, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    samples, messages, seconds = (found[name] for name in ("samples", "messages", "seconds"))
    each = samples / messages, found["ranges"] / messages
    return samples / seconds, 1e6 * seconds / samples, 1e6 * seconds / messages, *each


def compare(pythons):
    print(f"\nprocessor time of rank 0's main thread, medians of {REPEATS}, in turn")
    print_row(WIDTHS, TITLES)
    for case, changes in CASES.items():
        for workers in WORKERS:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "campaign.yaml"
                path.write_text(campaign_text(changes))
                runs = [
                    [measured(python, path, workers) for python in pythons] for _ in range(REPEATS)
                ]
            for python, columns in zip(pythons, zip(*runs, strict=True), strict=True):
                rate, sample, message, samples, ranges = map(
                    statistics.median, zip(*columns, strict=True)
                )
                row = f"{rate:.0f}", f"{sample:.2f}", f"{message:.0f}", f"{samples:.1f}"
                print_row(WIDTHS, (case, workers, python[-34:], *row, f"{ranges:.1f}"))


@pytest.mark.benchmark
def test_print_what_messages_cost_rank_zero():
    compare([sys.executable])


if __name__ == "__main__":
    compare(sys.argv[1:] or [sys.executable])
