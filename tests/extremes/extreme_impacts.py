"""Impacts over many decades of everything, and what must hold for each of them.

`EXTREME_EXAMPLES` in the environment multiplies how many are drawn.
"""

import math
import os

import numba
import numpy as np
from contact_pairs import R, contact_pair, laws_2003, laws_2004, plain_log_ratio
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from agglom_mpi.physics.heating import OwnEnergy, PairSplit
from agglom_mpi.physics.impact_solvers import TOLERANCE, first_root
from agglom_mpi.physics.restitution import log_pressure_ratio, log_pressure_scale

EPSILON = 2.0**-52
MAX_STEPS = 1000
"""Steps of the walk to a root that no impact needs: the most in 4.9 million random impacts and
295 thousand beside folds were 279."""


def examples(count):
    factor = int(os.environ.get("EXTREME_EXAMPLES", "1"))
    return settings(
        max_examples=math.ceil(count * factor),
        deadline=None,
        derandomize=factor == 1,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )


def make_2003(**options):
    return laws_2003(**options)


def make_2004(**options):
    return laws_2004(**options)._replace(heating=PairSplit.Numbers())


def make_own_energy(**options):
    return laws_2004(**options)._replace(heating=OwnEnergy.Numbers())


CLOSED = [make_2003, make_2004]
"""Both published laws of impact, with the heat that closes the first law."""


def decades(low, high):
    return st.floats(low, high).map(lambda power: 10.0**power)


def or_none(values):
    return st.one_of(st.just(0.0), values)


@st.composite
def impacts(draw, make, softening=(-6.0, 6.0)):
    """Laws and a pair from nanometres to kilometres; half of them with a hardness near bonding."""
    radius, ratio = draw(decades(-9, 3)), draw(decades(0, 3))
    radii = (radius, radius * ratio) if draw(st.booleans()) else (radius * ratio, radius)
    temperatures = (draw(decades(-3, 6)), draw(decades(-3, 6)))
    w = draw(or_none(decades(-12, 8)))
    pair = contact_pair(
        w,
        slip=w * draw(or_none(decades(-6, 6))),
        radii=radii,
        temperatures=temperatures,
        density=draw(decades(-3, 9)),
        frame=(w * draw(st.floats(-3.0, 3.0)), w * draw(st.floats(-3.0, 3.0))),
    )
    capacity = draw(decades(-3, 6))
    lighter = min(pair.mass_i, pair.mass_j)
    rise = draw(or_none(decades(-3, 5)))
    laws = make(
        hardness=draw(decades(-3, 15)),
        energy=R * min(temperatures) * draw(decades(*softening)),
        friction=draw(or_none(decades(-6, 1))),
        heat=rise * lighter * capacity / (math.pi * pair.radius**2),
        capacity=capacity,
        initial=draw(st.sampled_from([0.0, 0.01, 0.5, 1.0])),
    )
    if w > 0.0 and draw(st.booleans()):
        short = draw(st.sampled_from([-1.0, 1.0])) * draw(decades(-16, 2))
        logarithm = (
            float(plain_log_ratio(laws, pair, 1.0)) + math.log(laws.hardness.hardness) + short
        )
        if abs(logarithm) < 690.0:
            hardness = laws.hardness._replace(hardness=math.exp(logarithm))
            laws = laws._replace(hardness=hardness)
    return laws, pair


@st.composite
def folded_impacts(draw, make):
    """Impacts just beside a fold: ln r − ln d has a maximum away from d = 1 that nearly is a root.

    Laws, pair, ln d of the fold, and ln r − ln d there.
    """
    softening = draw(decades(1.0, 4.0))
    w = draw(decades(-3, 5))
    capacity = w * w / (softening * 100.0) * draw(decades(-1.0, 3.0))
    energy = softening * R * 100.0
    slip = w * draw(or_none(decades(-2, 1)))
    pair = contact_pair(w, slip, temperatures=(100.0, 100.0), frame=(-0.5 * w, -0.5 * slip))
    friction = draw(or_none(decades(-2, 0)))
    laws = make(hardness=1.0, energy=energy, friction=friction, heat=0.0, capacity=capacity)
    found = highest_fold(laws, pair)
    if found is None:
        return None
    place, top, above_end = found
    # The plain equation is known to the roundings of the numbers that it sums.
    least = math.log10(1e-13 * (50.0 + softening))
    excess = draw(st.sampled_from([-1.0, 1.0])) * draw(decades(least, 0.0))
    # Hardness and the pressure over it must both be floats.
    if abs(top - excess) > 670.0 or excess > 0.5 * above_end:
        return None
    hardness = laws.hardness._replace(hardness=math.exp(top - excess))
    return laws._replace(hardness=hardness), pair, place, excess


def highest_fold(laws, pair):
    """First maximum of ln r − ln d above all larger d: ln d, value, value less that at d = 1."""
    grid = np.concatenate([-np.logspace(-6.0, -0.5, 400), np.linspace(-0.33, -30.0, 3000)])
    excess = excess_of(laws, pair, grid)
    highest = np.maximum.accumulate(np.concatenate([[excess_of(laws, pair, 0.0)], excess]))
    peaks = np.flatnonzero(
        (excess[1:-1] > excess[:-2]) & (excess[1:-1] >= excess[2:]) & (excess[1:-1] > highest[1:-2])
    )
    if len(peaks) == 0:
        return None
    k = peaks[0] + 1
    fit = minimize_scalar(
        lambda x: -float(excess_of(laws, pair, x)),
        bounds=(grid[k + 1], grid[k - 1]),
        method="bounded",
        options={"xatol": 1e-12},
    )
    above_end = -float(fit.fun) - float(highest[0])
    return (float(fit.x), -float(fit.fun), above_end) if above_end > 0.0 else None


def excess_of(laws, pair, logarithm):
    """Ln r − ln d at some ln d: positive where the pressure asks for a larger deficit."""
    return plain_log_ratio(laws, pair, np.exp(logarithm)) - logarithm


@numba.njit(error_model="numpy")
def walk(laws, pair):
    """Ln d of the walk's end and its steps; none if the pair bonds."""
    scale = log_pressure_scale(laws, pair)
    if log_pressure_ratio(laws, pair, scale, 1.0) >= 0.0 or scale == -math.inf:
        return 0.0, 0
    return first_root(laws, pair, scale)


def softening_of(laws, pair):
    """U/(Rθ) of the colder sphere before the impact."""
    return laws.hardness.activation_energy / (R * min(pair.temperature_i, pair.temperature_j))


def rounding_of_log_ratio(laws, pair):
    """What roundings leave unknown of ln r: some of the size of what it is the sum of."""
    return 16.0 * EPSILON * (50.0 + softening_of(laws, pair))


def most_residual(laws, pair, deficit):
    """|e − G(e)| = d·|ln r − ln d| where ln d is known to `TOLERANCE`.

    The slope of ln r − ln d is at most 4 without heat. Heat adds U/(Rθ) times |d ln θ/d ln d|,
    which is at most 2: friction of constant μ can fall with d as fast as its heat is large.
    """
    if deficit == 0.0:
        return 0.0
    slope = 4.0 + 2.0 * softening_of(laws, pair)
    place = 2.0 * TOLERANCE * max(1.0, abs(math.log(deficit)))
    return deficit * (place * slope + rounding_of_log_ratio(laws, pair))


def assert_sound(laws, pair, impact):
    """Everything that an impact of any size must keep where heat closes the first law."""
    numbers = [value for value in impact if not isinstance(value, bool)]
    assert all(map(math.isfinite, numbers))
    assert 0.0 <= impact.deficit <= 1.0
    assert not impact.capped
    if impact.bonds:
        return
    assert 0.0 <= impact.residual <= most_residual(laws, pair, impact.deficit)
    momentum = pair.reduced_mass * pair.approach_speed
    assert momentum <= impact.normal_impulse <= 2.0 * momentum
    # Slip is stopped, not reversed, and no energy is made
    assert 0.0 <= impact.friction_impulse <= pair.reduced_mass * pair.slip_speed
    assert impact.loss >= 0.0
    assert impact.reaction >= 0.0
    heat = impact.loss + impact.reaction
    assert abs(impact.heat_i + impact.heat_j - heat) <= 8.0 * EPSILON * heat
    assert impact.heat_i == impact.heat_j
