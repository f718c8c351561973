"""Whether members drawn from a small set are members: [B], within 2 % of the largest growth.

`python tests/benchmarks/bench_set_members.py [SEEDS [MEMBERS]]`. The set is a corner of the box of
ten variables, in which no even point lies, so that its truth cannot be told as in
`bench_feasible_set.py`. Campaigns are those of jobs/agglomeration_2004_surrogate.yaml with 816
samples. Each member is simulated by samples that no search has seen. The largest growth is that of
the emulator, so what is checked is the emulator near it: its intervals, and P against that maximum.
"""

import re
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from bench_feasible_set import FRESH, JOBS, campaign_file, simulated

from agglom_mpi.inference.feasible_set import FeasibleSet

TOLERANCE, GENERATIONS, SAMPLES = 0.02, 34, 48
TITLES = ("volume", "expected error", "maximum", "P", "share", "coverage", "mean z")


def searched(seed, folder):
    """Run a campaign, and return its set."""
    text = (JOBS / "agglomeration_2004_surrogate.yaml").read_text()
    text = re.sub(r"(?m)^seed: .*$", f"seed: {seed}", text)
    text = re.sub("generations: [0-9]+", f"generations: {GENERATIONS}", text)
    file = campaign_file(Path(folder) / f"{seed}.yaml", f"final: none\n{text}")
    return FeasibleSet(file, TOLERANCE)


def scores(found, members):
    """Mean P of members, how many are, coverage of 90 % intervals, and the mean z-score."""
    emulated = found.emulated
    strings = found.points.draw(emulated, members, np.random.default_rng(0))
    mean, deviation = emulated.mean(strings)[:, 0], emulated.deviation(strings)[:, 0]
    campaign = emulated.box.campaign
    values = [simulated(campaign, s, FRESH, SAMPLES)["mean_radius_ratio"] for s in strings]
    true = np.mean(values, axis=1)
    error = np.std(values, axis=1, ddof=1) / np.sqrt(SAMPLES)
    away = (mean - true) / np.hypot(deviation, error)
    maximum, _ = found.maximum
    share = np.mean(true >= (1.0 - TOLERANCE) * maximum)
    probability = emulated.probability(strings).mean()
    return maximum, probability, share, np.mean(np.abs(away) < 1.6449), away.mean()


def run(seeds=5, members=50):
    print(f"\n[B], within 2 % of the largest growth; {members} members, {SAMPLES} samples each")
    print("  ".join(f"{title:>14}" for title in TITLES))
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(1, seeds + 1):
            found = searched(seed, folder)
            rows.append((found.volume, found.expected_error, *scores(found, members)))
            print("  ".join(f"{value:14.3g}" for value in rows[-1]), flush=True)
    print("mean\n" + "  ".join(f"{value:14.3g}" for value in np.mean(rows, axis=0)))


@pytest.mark.benchmark
def test_print_whether_drawn_members_are_members():
    run()


if __name__ == "__main__":
    run(*(int(word) for word in sys.argv[1:]))
