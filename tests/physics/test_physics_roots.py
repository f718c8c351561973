"""The smallest-root rule under Arrhenius softening, against a plain dense scan; no overflow."""

import itertools
import math

import numba
import numpy as np
import pytest
from contact_pairs import (
    R,
    constant_laws,
    contact_pair,
    laws_2003,
    laws_2004,
    plain_log_ratio,
    pressure_scale,
    scanned_root,
)
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from plain_python import COMPILES

from agglom_mpi.physics.friction import ConstantFriction
from agglom_mpi.physics.heating import OwnEnergy
from agglom_mpi.physics.impact_solvers import STEP_CAP, first_root, unique_root
from agglom_mpi.physics.restitution import log_pressure_ratio, log_pressure_scale
from agglom_mpi.simulation.impact import solve_impact

SETTINGS = settings(
    max_examples=150 if COMPILES else 50,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)


def decades(low, high):
    return st.floats(low, high).map(lambda power: 10.0**power)


@st.composite
def impacts(draw, make, slowest=-6.0, strongest=50.0):
    """Laws and a pair; the pressure at e = 0 is set within reach of the softened hardness."""
    temperatures = (draw(decades(1.5, 3.5)), draw(decades(1.5, 3.5)))
    softening = draw(st.floats(0.0, strongest))
    laws = make(
        hardness=draw(decades(3, 10)),
        energy=softening * R * min(temperatures),
        friction=draw(st.floats(0.0, 1.0)),
        heat=draw(st.sampled_from([0.0, 1.0])) * draw(decades(0, 9)),
        capacity=draw(decades(0, 4)),
        initial=draw(st.sampled_from([0.0, 0.01, 0.5])),
    )
    radii = (draw(decades(-6, -1)), draw(decades(-6, -1)))
    # ln X between that of an elastic impact and the hot limit of bonding: the range where roots are
    x = math.exp(draw(st.floats(slowest, softening + 2.0)))
    w = math.sqrt(x / pressure_scale(laws, contact_pair(1.0, radii=radii)))
    slip = w * draw(st.sampled_from([0.0, 1.0])) * draw(decades(-2, 2))
    frame = (w * draw(st.floats(-3.0, 3.0)), w * draw(st.floats(-3.0, 3.0)))
    pair = contact_pair(w, slip, radii, temperatures, frame=frame)
    return laws, pair


def softest_slope(laws, pair):
    """Largest size of the numbers that are summed in ln r: a bound of its rounding error."""
    coldest = min(pair.temperature_i, pair.temperature_j)
    return 50.0 + laws.hardness.activation_energy / (R * coldest)


def assert_smallest_root(laws, pair):
    impact = solve_impact(laws, pair)
    scanned = scanned_root(laws, pair)
    start = float(plain_log_ratio(laws, pair, 1.0))
    if scanned is None or impact.bonds:
        at_the_limit = abs(start) < 1e-12 * softest_slope(laws, pair)
        assert (scanned is None and impact.bonds) or at_the_limit
        return
    assert not impact.capped
    found = math.log(impact.deficit) if impact.deficit > 0.0 else -math.inf
    if scanned == -math.inf:
        assert found < -60.0 + 1e-9
        return
    excess = float(plain_log_ratio(laws, pair, math.exp(found)) - found)
    # The softening makes ln r as steep as U/(Rθ): rounding of d moves it by that much.
    steep = softest_slope(laws, pair)
    if abs(excess) < 1e-6:  # the equation holds at what was found
        assert abs(excess) < 1e-12 * steep**2
        # Two scan points may straddle a pair of roots: what was found may only be the larger d.
        assert found >= scanned - 1e-11 * steep
    else:  # r is cut off: the heat is negative and the hardness infinite on one side
        assert found == pytest.approx(scanned, abs=1e-3)


@SETTINGS
@given(impacts(laws_2003))
def test_the_2003_impact_is_the_smallest_root_in_restitution(case):
    assert_smallest_root(*case)


@SETTINGS
@given(impacts(laws_2004))
def test_the_own_energy_impact_is_the_smallest_root_in_restitution(case):
    assert_smallest_root(*case)


def several_roots():
    """Return impacts just short of bonding that heat enough to soften, so with several roots."""
    found = []
    grid = np.linspace(0.0, -40.0, 4001)
    for make, softening in itertools.product((laws_2003, laws_2004), (20.0, 40.0, 80.0)):
        for w, short in itertools.product(np.logspace(1, 2.5, 12), (1e-3, 0.1, 0.5, 1.0, 2.0)):
            pair = contact_pair(w, temperatures=(100.0, 100.0), frame=(-0.5 * w, 0.0))
            options = {"energy": softening * R * 100.0, "friction": 0.0, "heat": 0.0}
            laws = make(1.0, capacity=10.0, **options)
            bonding = math.exp(float(plain_log_ratio(laws, pair, 1.0)))
            laws = make(bonding * math.exp(short), capacity=10.0, **options)
            excess = plain_log_ratio(laws, pair, np.exp(grid)) - grid
            if np.count_nonzero(np.diff(np.sign(excess)) != 0) > 1:
                found.append((laws, pair))
    return found


def test_where_there_are_several_roots_the_impact_is_the_one_of_smallest_restitution():
    cases = several_roots()
    assert len(cases) >= 20
    for laws, pair in cases:
        scanned = scanned_root(laws, pair)
        assert math.log(solve_impact(laws, pair).deficit) == pytest.approx(scanned, abs=1e-9)


@numba.njit(error_model="numpy")
def both_roots(laws, pair):
    scale = log_pressure_scale(laws, pair)
    plastic = log_pressure_ratio(laws, pair, scale, 1.0)
    if plastic >= 0.0:
        return np.nan, np.nan, 0
    walked, steps = first_root(laws, pair, scale)
    return unique_root(laws, pair, scale, plastic), walked, steps


@SETTINGS
@given(impacts(laws_2003, strongest=4.0))
def test_up_to_four_of_softening_the_root_is_unique(case):
    """d ln r/d ln d < 1 everywhere, so a walk and a bracket end at the same place."""
    laws, pair = case
    unique, walked, steps = both_roots(laws, pair)
    assume(not math.isnan(unique))
    assert steps < STEP_CAP
    # Near softening 4 the slope of ln r − ln d may vanish to second order: d moves by the cube root
    excess = [float(plain_log_ratio(laws, pair, math.exp(x)) - x) for x in (unique, walked)]
    assert max(map(abs, excess)) < 1e-12
    assert unique == pytest.approx(walked, abs=1e-9)
    grid = np.linspace(0.0, -40.0, 2001)
    signs = np.sign(plain_log_ratio(laws, pair, np.exp(grid)) - grid)
    assert np.count_nonzero(np.diff(signs) != 0) <= 1


SPEEDS = [0.0, 1e-12, 1e-3, 1.0, 1e3, 1e8]
EXTREMES = [
    (softening, hardness, temperature)
    for softening in (0.0, 1e-6, 1.0, 5.0, 710.0, 1e6)
    for hardness in (1e-3, 1e6, 1e15)
    for temperature in (1e-3, 300.0, 1e6)
]


@pytest.mark.parametrize("make", [laws_2003, laws_2004])
@pytest.mark.parametrize("initial", [0.0, 0.01])
def test_nothing_overflows_and_no_deficit_leaves_its_range(make, initial):
    for softening, hardness, temperature in EXTREMES:
        energy = softening * R * temperature
        for w in SPEEDS:
            for slip, heat in ((0.0, 0.0), (3.0 * w, 1e7)):
                laws = make(hardness=hardness, energy=energy, heat=heat, initial=initial)
                pair = contact_pair(w, slip, temperatures=(temperature, 2.0 * temperature))
                impact = solve_impact(laws, pair)
                numbers = [value for value in impact if not isinstance(value, bool)]
                assert all(map(math.isfinite, numbers)), (softening, hardness, temperature, w)
                assert 0.0 <= impact.deficit <= 1.0
                assert not impact.capped


def test_at_zero_kelvin_nothing_bonds_unless_the_impact_warms_it():
    cold = contact_pair(100.0, temperatures=(0.0, 0.0))
    assert solve_impact(laws_2003(hardness=1e3, heat=0.0, capacity=1.0), cold).bonds
    frozen = solve_impact(laws_2003(hardness=1e3, heat=0.0, capacity=math.inf), cold)
    assert not frozen.bonds
    assert frozen.deficit == 0.0


def test_constant_restitution_loses_nothing_at_one_and_bonds_at_zero():
    pair = contact_pair(3.0, 2.0, (1e-3, 2e-3))
    elastic = solve_impact(constant_laws(1.0, OwnEnergy.Numbers(), None), pair)
    assert elastic.loss == 0.0
    assert elastic.normal_impulse == pytest.approx(2.0 * pair.reduced_mass * 3.0, rel=1e-15)
    assert solve_impact(
        constant_laws(0.0, OwnEnergy.Numbers(), ConstantFriction.Numbers(0.1)), pair
    ).bonds
