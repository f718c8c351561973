"""What a collision costs in shear and between rough grains, beside the same gas without.

Run with `pytest tests/benchmarks/bench_sheared.py -m benchmark -s` (a minute or two, most of it
compiling). Processor time of one thread, the engine alone; runs of what is compared take turns.
"""

import math
import statistics
import sys
from pathlib import Path

import pytest
from bench_event import SPEED, make_gas, print_row, time_of
from bench_leave_out import begin, changed, package, timed

sys.path.append(str(Path(__file__).parents[1] / "simulation"))
from sheared_gas import navier_stokes

from agglom_mpi.physics.rough import RoughFriction
from agglom_mpi.simulation.boundary import Shear

COUNT = 1000
EACH = 20
"""Collisions per particle, about."""

REPEATS = 21

CASES = ((0.95, 0.1), (0.9, 0.1), (0.9, 0.2), (0.9, 0.3), (0.8, 0.1), (0.8, 0.3))
"""Restitution and volume fraction."""


def sheared(e, fraction):
    """Return a gas in shear, which starts with about the temperature of its steady state."""
    gas = make_gas(fraction, COUNT, e, EACH)
    temperature, _ = navier_stokes(e, fraction)
    rate = SPEED / math.sqrt(3.0 * temperature) / (2.0 * gas.radius)
    even = time_of(make_gas(fraction, COUNT, 1.0, EACH), fraction, EACH)
    return gas._replace(escape=Shear.Numbers(rate), end_time=even)


def rough(e, fraction):
    """Return a gas of rough grains."""
    return changed(
        make_gas(fraction, COUNT, e, EACH), friction=RoughFriction.Numbers(0.0, 0.3, 0.5)
    )


def print_pair(widths, e, fraction, other):
    """Print what a collision costs in a smooth gas without shear, in another, and their ratio."""
    runs = [(package, each, begin(each)) for each in (make_gas(fraction, COUNT, e, EACH), other)]
    hits = [timed(*each)[1] for each in runs]  # compiles
    costs = [[timed(*each)[0] for each in runs] for _ in range(REPEATS)]
    lean, full = (statistics.median(column) for column in zip(*costs, strict=True))
    speed = statistics.median(first / second for first, second in costs)
    each = [f"{2.0 * count / COUNT:.1f}" for count in hits]
    print_row(
        widths, (e, fraction, *each, f"{1e9 * lean:.0f}", f"{1e9 * full:.0f}", f"{speed:.3f}")
    )


@pytest.mark.benchmark
@pytest.mark.parametrize("kind", [sheared, rough])
def test_print_the_speed_beside_smooth_grains_without_shear(kind):
    print(f"\n{kind.__name__}: {COUNT} grains, event engine; median of {REPEATS} pairs of runs")
    widths = (6, 8, 12, 12, 14, 14, 16)
    titles = ("e", "phi", "collisions", "per grain", "ns/collision", "without, with", "speed")
    print_row(widths, titles)
    for e, fraction in CASES:
        print_pair(widths, e, fraction, kind(e, fraction))
