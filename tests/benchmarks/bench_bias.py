"""The error of time steps: mean growth with a stepper less that with the event engine.

Run with `pytest tests/benchmarks/bench_bias.py -m benchmark -s`, or as a program, with the number
of samples of both campaigns as arguments. The same samples run on every engine, so their starts are
the same and the differences are paired.
"""

import math
import statistics
import sys
from pathlib import Path

import numpy as np
import pytest

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.simulation.engines import AdaptiveSteps, EventDriven, FixedSteps
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate

JOBS = Path(__file__).parents[2] / "jobs"

ROWS = {
    "accretion_2003": (
        [4.326, 0.633, 6141.898, 67.188e6, 1279.542, 0.307, 330.652, 707.351, 5940883.989],
        400,
    ),
    "agglomeration_2004": (
        [
            184.688,
            0.79041,
            6652.7,
            265480.0,
            1796.3,
            1.3456e-3,
            502.18,
            352.41,
            1776500.0,
            8.3685e15,
        ],
        40,
    ),
}
"""First rows of [A table 1] and [B tables 1-3] in SI units, and the samples to average."""

STEPS = (50, 200, 500, 1000, 2000, 5000, 10_000, 20_000)
CEILINGS = (1, 10, 1000)
"""Longest over shortest step of the adaptive engine; 1000 is published [B 6.14]."""


def engines(end_time):
    """Engines to measure: a name, the shortest step in s, the engine."""
    for steps in STEPS:
        yield "fixed", end_time / steps, FixedSteps(steps=steps)
    for ceiling in CEILINGS:
        for steps in STEPS:
            floor = end_time / steps
            name = f"adaptive, to {ceiling}"
            yield name, floor, AdaptiveSteps(floor=floor, ceiling=ceiling * floor)


def growth(campaign, values, samples, engine):
    """Mean b/b0 of each sample, and the median of their processor times in ms."""
    simulate(campaign, values, 0, engine)
    outcomes = [simulate(campaign, values, k, engine) for k in range(samples)]
    ratios = np.array([outcome.mean_radius_ratio for outcome in outcomes])
    return ratios, statistics.median(outcome.cpu_seconds for outcome in outcomes) * 1e3


def mean_and_error(values):
    return values.mean(), values.std(ddof=1) / math.sqrt(len(values))


def print_bias(job, samples=None):
    """Print the table of one campaign."""
    campaign = load_campaign(JOBS / f"{job}.yaml")
    row, usual = ROWS[job]
    samples = samples or usual
    values = dict(zip(TEN.names, row, strict=False))
    end_time = campaign.scene.build(campaign.parameters(values)).end_time
    exact, cost = growth(campaign, values, samples, EventDriven())
    mean, error = mean_and_error(exact)
    print(f"\n{job}, row 1, {samples} samples, end time {end_time:.4g} s")
    print(f"event engine: b/b0 = {mean:.4f} ± {error:.4f}, {cost:.2f} ms per sample")
    print("engine               step/s     bias      ±         ms per sample")
    for name, step, engine in engines(end_time):
        stepped, cost = growth(campaign, values, samples, engine)
        bias, error = mean_and_error(stepped - exact)
        print(f"{name:<20} {step:<10.3g} {bias:+.4f}   {error:.4f}    {cost:.2f}", flush=True)


@pytest.mark.benchmark
@pytest.mark.parametrize("job", ROWS)
def test_print_the_bias_of_time_steps(job):
    print_bias(job)


if __name__ == "__main__":
    chosen = [int(word) for word in sys.argv[1:]] or [None] * len(ROWS)
    for job, samples in zip(ROWS, chosen, strict=True):
        print_bias(job, samples)
