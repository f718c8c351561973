"""Bounds of slopes, by which the solver knows that an interval holds no root."""

import sys

import numba
import pytest
from contact_pairs import contact_pair
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_python import COMPILES

from agglom_mpi.physics.friction import (
    ConstantFriction,
    RestitutionScaledFriction,
    impulse_slopes,
    tangential_impulse,
)
from agglom_mpi.physics.heating import OwnEnergy, PairSplit, impact_heats, least_heat_slopes
from agglom_mpi.physics.rough import RoughFriction

SETTINGS = settings(max_examples=300 if COMPILES else 40, deadline=None, derandomize=True)
SPEEDS = st.floats(1e-3, 1e3)
RADII = st.tuples(st.floats(1e-4, 1e-2), st.floats(1e-4, 1e-2))
FRAMES = st.tuples(st.floats(-100.0, 100.0), st.floats(-100.0, 100.0))
DEFICITS = st.lists(st.floats(1e-6, 1.0), min_size=4, max_size=4, unique=True).map(sorted)
FRICTION = (None, ConstantFriction, RestitutionScaledFriction, RoughFriction)
TANGENTIAL = st.sampled_from([-1.0, -0.3, 0.0, 0.44, 1.0])
# Round-off of a difference, relative to the larger value.
ROUNDING = 1e-13


@numba.njit(error_model="numpy")
def impulse(friction, pair, deficit):
    return tangential_impulse(friction, pair, deficit)


@numba.njit(error_model="numpy")
def bounds_of_impulse(friction, pair, lower, upper):
    return impulse_slopes(friction, pair, lower, upper)


@numba.njit(error_model="numpy")
def heats(heating, friction, pair, deficit):
    return impact_heats(heating, friction, pair, deficit)


@numba.njit(error_model="numpy")
def bounds_of_heats(heating, friction, pair, lower, upper):
    return least_heat_slopes(heating, friction, pair, lower, upper)


def law(kind, coefficient, tangential):
    if kind is RoughFriction:
        return kind.Numbers(0.0, coefficient, tangential)
    return None if kind is None else kind.Numbers(coefficient)


@pytest.mark.parametrize("kind", FRICTION)
@SETTINGS
@given(SPEEDS, SPEEDS, RADII, st.floats(0.0, 2.0), TANGENTIAL, DEFICITS)
def test_the_tangential_impulse_changes_as_its_slopes_allow(
    kind, approach, slip, radii, coefficient, tangential, deficits
):
    pair, friction = contact_pair(approach, slip, radii), law(kind, coefficient, tangential)
    lower, a, b, upper = deficits
    least, most = bounds_of_impulse(friction, pair, lower, upper)
    at_a, at_b = (impulse(friction, pair, deficit) for deficit in (a, b))
    # Subnormal impulses have fewer digits.
    rounding = ROUNDING * (abs(at_a) + abs(at_b)) + sys.float_info.min
    assert least * (b - a) - rounding <= at_b - at_a <= most * (b - a) + rounding


@pytest.mark.parametrize("kind", FRICTION)
@pytest.mark.parametrize("heating", [PairSplit.Numbers(), OwnEnergy.Numbers()])
@SETTINGS
@given(SPEEDS, SPEEDS, RADII, FRAMES, st.floats(0.0, 2.0), TANGENTIAL, DEFICITS)
def test_heats_rise_with_the_deficit_at_least_as_fast_as_their_slopes_say(
    kind, heating, approach, slip, radii, frame, coefficient, tangential, deficits
):
    pair, friction = (
        contact_pair(approach, slip, radii, frame=frame),
        law(kind, coefficient, tangential),
    )
    lower, a, b, upper = deficits
    slopes = bounds_of_heats(heating, friction, pair, lower, upper)
    at_a, at_b = (heats(heating, friction, pair, deficit) for deficit in (a, b))
    # A sphere's loss is a difference of works, which are larger in a frame that moves.
    speed = sum(map(abs, (approach, slip, *frame)))
    rounding = ROUNDING * max(pair.mass_i, pair.mass_j) * speed**2
    for before, after, slope in zip(at_a, at_b, slopes, strict=True):
        assert after - before >= slope * (b - a) - rounding
