"""How often 95 % intervals hold the truth: on fresh samples, and those of the search itself.

Run with `pytest tests/benchmarks/bench_coverage.py -m benchmark -s`, or as a program, with the
sizes of both pools as arguments. A pool of samples of one published string is simulated, and all
of it is the truth; ensembles are drawn from it with replacement.
"""

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from bench_bias import ROWS
from goals import growth_target, maximum_growth, moment_targets

from agglom_mpi.accuracy.time_integration.stopping_study import at_stop, run_paths, stop
from agglom_mpi.analysis.estimates import interval
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import summaries
from agglom_mpi.search.objectives.moment_targets import MomentTarget
from agglom_mpi.statistics import t_95
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate

JOBS = Path(__file__).parents[2] / "jobs"
SIZES = {"accretion_2003": 20_000, "agglomeration_2004": 4000}
FRESH = (5, 10, 30, 100, 300)
REPEATS, ORDERS, RIVALS = 10_000, 4000, 20
MOMENTS = ("spread", "skewness", "kurtosis", "fourth")
MOMENT_SAMPLES, MOMENT_REPEATS = (30, 100, 300), 4000


def pool_of(campaign, job, size):
    values = dict(zip(TEN.names, ROWS[job][0], strict=False))
    records = [simulate(campaign, values, sample).record for sample in range(size)]
    return np.array(records)


def covers(truth, value, error, count):
    lower, upper = interval(float(value), float(error), int(count))
    return lower <= truth <= upper


def fresh(law, ratios, samples, rng):
    """Coverage of re-estimates of so many samples."""
    deviations = law.deviation(ratios)
    truth = abs(deviations.mean())
    draws = deviations[rng.integers(len(ratios), size=(REPEATS, samples))]
    values, errors = abs(draws.mean(axis=1)), draws.std(axis=1, ddof=1) / math.sqrt(samples)
    ends = zip(values, errors, strict=True)
    return np.mean([covers(truth, value, error, samples) for value, error in ends])


def searched(campaign, law, pool, rng):
    """Coverage of ensembles that the campaign's rule has ended: of all, and of the best of some.

    Also the mean of their samples, and of the objective of the best less the truth.
    """
    rules = campaign.ensemble
    truth, _ = law.of_rows(pool)
    draws = rng.integers(len(pool), size=(rules.max_samples, ORDERS))
    states, signed = run_paths(pool, law, draws)
    ends, _ = stop(rules, states, rules.min_samples, rules.max_samples)
    values = np.abs(at_stop(signed, ends))
    errors = at_stop(states.standard_error, ends)
    rows = zip(values, errors, ends, strict=True)
    held = np.array([covers(truth, *row) for row in rows]).reshape(-1, RIVALS)
    best = values.reshape(-1, RIVALS).argmin(axis=1)
    lucky = np.take_along_axis(held, best[:, np.newaxis], axis=1)
    bias = values.reshape(-1, RIVALS).min(axis=1).mean() - truth
    return held.mean(), lucky.mean(), ends.mean(), bias


def of_moments(pool, samples, repeats, rng):
    """Coverage of 95 % intervals of three moments, by so many samples, and errors over the true.

    The latter are the mean standard errors over the standard deviation of the moments themselves.
    """
    law = moment_targets(tuple(MomentTarget(name, 1.0) for name in MOMENTS))
    every = summaries(pool)
    truth = np.array([moment.value for moment in law.reached(every)])
    draws = rng.integers(len(pool), size=(repeats, samples))
    found = np.array(
        [[moment[3:5] for moment in law.reached([every[i] for i in draw])] for draw in draws]
    )
    values, errors = found[..., 0], found[..., 1]
    held = np.abs(values - truth) <= t_95(samples - 1) * errors
    return held.mean(axis=0), errors.mean(axis=0) / values.std(axis=0, ddof=1)


def print_moments(pool, repeats=MOMENT_REPEATS):
    """Print the coverage of intervals of moments by samples of a pool."""
    rng = np.random.default_rng(8)
    print(f"{'moments':<16}" + "".join(f"{name:<28}" for name in MOMENTS))
    for samples in MOMENT_SAMPLES:
        shares, ratios = of_moments(pool, samples, repeats, rng)
        words = [
            f"{share:.1%} ± {math.sqrt(share * (1 - share) / repeats):.1%}, error × {ratio:.3f}"
            for share, ratio in zip(shares, ratios, strict=True)
        ]
        print(f"F = {samples:<12}" + "".join(f"{text:<28}" for text in words), flush=True)


def print_coverage(job, size=None):
    """Print the table of one published string, for both objectives."""
    campaign, rng = load_campaign(JOBS / f"{job}.yaml"), np.random.default_rng(7)
    pool = pool_of(campaign, job, size or SIZES[job])
    print(f"\n{job}, row 1, pool of {len(pool)} samples, {REPEATS} re-estimates each")
    print(f"{'objective':<16}" + "".join(f"F = {samples:<6}" for samples in FRESH) + "±")
    laws = {"growth_target": growth_target(2.0)}
    laws["maximum_growth"] = maximum_growth(campaign.scene.particles)
    for name, law in laws.items():
        shares = [fresh(law, pool["mean_radius_ratio"], samples, rng) for samples in FRESH]
        words = "".join(f"{share:<10.2%}" for share in shares)
        print(f"{name:<16}{words}{math.sqrt(0.05 * 0.95 / REPEATS):.2%}")
        every, best, used, bias = searched(campaign, law, pool, rng)
        print(
            f"{'':<16}by the search's own rule, {used:.0f} samples on average: {every:.1%}; the "
            f"best of {RIVALS} such: {best:.1%}, biased by {bias:+.4f}",
            flush=True,
        )
    print_moments(pool)


@pytest.mark.benchmark
@pytest.mark.parametrize("job", SIZES)
def test_print_the_coverage_of_intervals(job):
    print_coverage(job)


if __name__ == "__main__":
    chosen = [int(word) for word in sys.argv[1:]] or [None] * len(SIZES)
    for job, size in zip(SIZES, chosen, strict=True):
        print_coverage(job, size)
