"""How alike strings end that start from the same random configurations: their correlation.

Run with `pytest tests/benchmarks/bench_common.py -m benchmark -s`, or as a program, with the number
of strings and of samples as arguments. Strings are drawn around one near the optimum of each
paper's question, at most a share of the box away. To compare two strings takes 1 - correlation
times as many samples as with configurations of their own.
"""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.random_streams import sample_stream
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.simulation.sample import simulate_scene
from agglom_mpi.variables import TEN

JOBS = Path(__file__).parents[2] / "jobs"
OPTIMA = {
    "accretion_2003": [22.6, 0.4367, 2717, 72.4e6, 882.7, 0.3659, 347.2, 155.1, 4.969e6],
    "agglomeration_2004": [200, 0.8, 1e4, 1e5, 1100, 5.5e-3, 550, 550, 5.5e6, 5.5e15],
}
STRINGS, SAMPLES, BLOCKS = 20, 300, 30
DISTANCES = (1e-3, 0.01, 0.1)


def strings_near(campaign, optimum, distance, count):
    """Strings uniform in the cube around one, shape (count, 10), within the box."""
    space = SearchSpace.of(campaign.variables)
    [centre] = space.to_unit(campaign.parameters(dict(zip(TEN.names, optimum, strict=False)))[None])
    rng = np.random.default_rng(7)
    moves = distance * rng.uniform(-1.0, 1.0, (count, space.dimensions))
    return space.from_unit(np.clip(centre + moves, 0.0, 1.0))


def grown(campaign, strings, samples, common):
    """Mean radius ratios of so many samples of each string, shape (strings, samples)."""
    found = np.empty((len(strings), samples))
    for row, string in zip(found, strings, strict=True):
        scene = campaign.scene.build(string)
        for k in range(samples):
            record, _ = simulate_scene(scene, sample_stream(campaign.seed, string, k, common))
            row[k] = record["mean_radius_ratio"]
    assert np.isfinite(found).all()
    return found


def of_pairs(values):
    """Correlations of all pairs of rows."""
    return np.corrcoef(values)[np.triu_indices(len(values), 1)]


def mean_correlation(values):
    """Mean correlation of all pairs of rows, and its jackknife error over blocks of columns."""
    blocks = np.array_split(np.arange(values.shape[1]), BLOCKS)
    without = [of_pairs(np.delete(values, block, axis=1)).mean() for block in blocks]
    return of_pairs(values).mean(), math.sqrt((BLOCKS - 1) * np.var(without))


def print_correlations(job, count=STRINGS, samples=SAMPLES):
    campaign = load_campaign(JOBS / f"{job}.yaml")
    print(f"\n{job}, {count} strings x {samples} samples near the optimum")
    print("within a share of the box  mean b/b0      correlation, all pairs     own configurations")
    for distance in DISTANCES:
        strings = strings_near(campaign, OPTIMA[job], distance, count)
        values = grown(campaign, strings, samples, common=True)
        means, (mean, error) = values.mean(axis=1), mean_correlation(values)
        pairs = of_pairs(values)
        said = f"{mean:+.4f} ± {error:.4f} ({pairs.min():+.2f} to {pairs.max():+.2f})"
        print(f"{distance:<26g} {means.min():.3f}..{means.max():.3f}   {said}", end="  ")
        own = grown(campaign, strings, samples, common=False) if distance == DISTANCES[-1] else None
        print("" if own is None else "{:+.4f} ± {:.4f}".format(*mean_correlation(own)), flush=True)


@pytest.mark.benchmark
@pytest.mark.parametrize("job", OPTIMA)
def test_print_how_alike_strings_with_common_configurations_end(job):
    print_correlations(job)


if __name__ == "__main__":
    for job in OPTIMA:
        print_correlations(job, *map(int, sys.argv[1:]))
