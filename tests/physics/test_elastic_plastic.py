"""Restitution of elastic–plastic spheres against Thornton's limits and an integrated contact."""

import math

import numpy as np
import pytest
from contact_pairs import contact_pair
from scipy.integrate import quad
from scipy.optimize import brentq

from agglom_mpi.physics.elastic_plastic import (
    ElasticPlasticRestitution,
    plastic_restitution,
    yield_speed,
)
from agglom_mpi.physics.restitution import solve_restitution

STEEL = ElasticPlasticRestitution(youngs_modulus=210e9, poisson_ratio=0.3, yield_pressure=3e9)


def solved(pair, law=STEEL):
    return solve_restitution(law.build({}), None, pair)


def restitution_by_work(speed):
    """e of a contact in units of p_y = R* = m* = E* = 1, by the work in and the work out.

    The force is Hertz's up to the yield overlap δ_y = a_y², a_y = π/2, then rises as π(δ − δ_y):
    the contact has the radius √δ, and its yielded part the pressure p_y. It unloads by Hertz as a
    sphere of the radius that gives the largest force at the same radius of the contact.
    """
    overlap = (0.5 * math.pi) ** 2

    def loading(d):
        beyond = max(d - overlap, 0.0)
        return 4.0 / 3.0 * min(d, overlap) ** 1.5 + math.pi * beyond

    def work_in(end):
        parts = [quad(loading, 0.0, min(end, overlap))[0], quad(loading, overlap, end)[0]]
        return sum(parts) if end > overlap else parts[0]

    deepest = brentq(lambda d: work_in(d) - 0.5 * speed * speed, 1e-6, 1e8, xtol=1e-12)
    radius = 4.0 / 3.0 * deepest**1.5 / loading(deepest)
    out = quad(lambda d: 4.0 / 3.0 * math.sqrt(radius) * d**1.5, 0.0, deepest / radius)[0]
    return math.sqrt(2.0 * out) / speed


YIELD_SPEED = math.sqrt(16.0 / 15.0 * (0.5 * math.pi) ** 5)
"""In the same units: ½w_y² = (8/15) a_y⁵."""


@pytest.mark.parametrize("speed", [1.001, 1.5, 3.0, 10.0, 100.0])
def test_restitution_is_the_work_out_over_the_work_in(speed):
    by_work = restitution_by_work(speed * YIELD_SPEED)
    assert plastic_restitution(1.0 / speed) == pytest.approx(by_work, rel=1e-6)


def test_below_the_yield_speed_impacts_are_elastic_and_the_law_is_continuous_there():
    pair = contact_pair(1.0)
    start = yield_speed(STEEL.limit, STEEL.modulus, pair)
    assert plastic_restitution(1.0) == pytest.approx(1.0, abs=1e-15)
    for share in (1e-9, 0.5, 1.0):
        assert solved(contact_pair(share * start)).deficit == 0.0
    assert 0.0 < solved(contact_pair(1.001 * start)).deficit < 1e-3


def test_fast_impacts_rebound_with_the_three_quarters_power_of_the_speed():
    # √(6√3/5) (1/(2√(6/5)))^¼ (w_y/w)^¼, 1.185 of it
    limit = math.sqrt(1.2 * math.sqrt(3.0)) * (0.5 / math.sqrt(1.2)) ** 0.25
    assert limit == pytest.approx(1.185, abs=5e-4)
    assert plastic_restitution(1e-10) == pytest.approx(limit * 1e-10**0.25, rel=1e-9)


def test_the_yield_speed_of_a_sphere_on_a_wall_is_that_of_thornton():
    wall = contact_pair(1.0, radii=(1e-3, 1e6), density=7800.0)
    modulus = 210e9 / (2.0 * (1.0 - 0.3**2))
    expected = (math.pi / (2.0 * modulus)) ** 2 * math.sqrt(0.4 / 7800.0) * 3e9**2.5
    assert yield_speed(3e9, modulus, wall) == pytest.approx(expected, rel=1e-8)


def test_a_yield_pressure_is_1_6_yield_stresses():
    by_stress = ElasticPlasticRestitution(youngs_modulus=210e9, yield_stress=3e9 / 1.6)
    pair = contact_pair(5.0)
    assert solved(pair, by_stress).deficit == pytest.approx(solved(pair).deficit, rel=1e-12)


@pytest.mark.parametrize("given", [{}, {"yield_pressure": 1e9, "yield_stress": 1e9}])
def test_one_of_yield_pressure_and_yield_stress_is_given(given):
    with pytest.raises(ValueError, match="yield_pressure, yield_stress"):
        ElasticPlasticRestitution(youngs_modulus=210e9, **given)


def test_restitution_never_rises_with_speed_over_all_decades_and_sizes():
    for radius in np.geomspace(1e-9, 1e3, 13):
        found = [solved(contact_pair(w, radii=(radius, radius))) for w in np.geomspace(1e-6, 1e6)]
        assert all(0.0 <= each.deficit < 1.0 and not each.bonds for each in found)
        assert np.all(np.diff([each.deficit for each in found]) >= 0.0)
