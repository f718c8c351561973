"""Cooling of one grain at extremes: against independent references, and what no answer may break.

`EXTREME_EXAMPLES` in the environment multiplies how many are drawn.
"""

import itertools
import math

import numba
import numpy as np
import pytest
from extreme_impacts import decades, examples, or_none
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from agglom_mpi.physics.cooling import (
    COLDEST,
    PANEL,
    QuarticCooling,
    RadiativeCooling,
    equilibrium_temperature,
    exact_temperature,
    panel_time,
)

pytestmark = pytest.mark.plain

B = 5.670374419e-8
SURFACE = 2.0
CAPACITY = 3.0
SHARES = np.logspace(-12.0, 12.0, 49)
"""Times over the time constant."""

STARTS = pytest.mark.parametrize("start", [0.0, 1e-3, 1.0, 299.0, 301.0, 5e3, 1e6])


@numba.njit(error_model="numpy")
def exact(law, temperature, time):
    return exact_temperature(law, temperature, SURFACE, CAPACITY, time)


def radiative(emissivity=0.5, surroundings=300.0, convection=0.0, ambient=300.0):
    rest = equilibrium_temperature(emissivity, surroundings, convection, ambient)
    return RadiativeCooling.Numbers(emissivity, surroundings, convection, ambient, rest)


def flux(law, temperature):
    """Heat lost over the surface, W/m², written as in the paper  [B 6.19–6.20]."""
    s = law.surroundings
    radiated = (temperature - s) * (temperature + s) * (temperature**2 + s**2)
    return B * law.emissivity * radiated + law.convection * (temperature - law.ambient)


def time_between(law, start, end):
    """Time from `start` to `end` by adaptive quadrature of dθ/θ' over ln of the distance."""
    rest = law.equilibrium
    total = math.log((start - rest) / (end - rest))

    def integrand(v):
        distance = (start - rest) * math.exp(-v)
        return distance / flux(law, rest + distance)

    value, _ = quad(integrand, 0.0, total, epsabs=0.0, epsrel=1e-13, limit=500)
    return value * CAPACITY / SURFACE


def time_constant(law, start):
    """Time in which the distance to equilibrium falls by e at the rate of the start, s."""
    distance = start - law.equilibrium
    if distance == 0.0:
        return CAPACITY / SURFACE / (4.0 * B * law.emissivity * start**3 + law.convection)
    return CAPACITY / SURFACE * distance / flux(law, start)


LAWS = [
    radiative(),
    radiative(surroundings=1e-3),
    radiative(emissivity=1.0, surroundings=1e6),
    radiative(convection=10.0, ambient=1e-3),
    radiative(emissivity=1e-6, surroundings=1e3, convection=1e3, ambient=10.0),
    radiative(surroundings=0.0, convection=1e-6, ambient=300.0),
]
MIXED = pytest.mark.parametrize("law", LAWS)


@MIXED
@STARTS
def test_on_the_way_to_equilibrium_it_keeps_the_time_of_an_adaptive_quadrature(law, start):
    rest = law.equilibrium
    for share in (1e-3, 0.1, 0.5, 0.9, 0.999):
        end = start + share * (rest - start)
        if abs(end - rest) < 1e-3 * rest:  # there the plain flux loses its digits
            continue
        time = time_between(law, start, end)
        folds = 1.0 + math.log((start - rest) / (end - rest))
        # A relative error of the time moves the distance by so much for every e-fold.
        error = 4e-12 * folds * abs(end - rest) + 4.0 * math.ulp(max(start, rest))
        assert exact(law, start, time) == pytest.approx(end, rel=1e-15, abs=error)


@MIXED
@STARTS
def test_for_short_times_it_cools_at_the_rate_of_the_start(law, start):
    """Also where a grain is far colder than its surroundings, whose digits it lost to them."""
    constant = time_constant(law, start)
    distance = start - law.equilibrium
    for share in SHARES[SHARES < 1e-8]:
        change = exact(law, start, share * constant) - start
        # The next term of the series is at most 4 × share²/2 × the distance.
        error = 2.0 * math.ulp(start) + (2.0 * share + 1e-12) * share * abs(distance)
        assert change == pytest.approx(-share * distance, rel=1e-12, abs=error)


@MIXED
@STARTS
def test_for_long_times_it_ends_at_equilibrium(law, start):
    constant = CAPACITY / SURFACE / (4.0 * B * law.emissivity * law.equilibrium**3 + law.convection)
    for time in (*(100.0 * constant * SHARES[SHARES > 1.0]), 1e300, math.inf):
        assert exact(law, start, time) == pytest.approx(law.equilibrium, rel=1e-15)


@pytest.mark.parametrize("start", [1e-3, 1.0, 300.0, 1e6])
@pytest.mark.parametrize("emissivity", [1e-6, 1.0])
def test_into_zero_kelvin_it_follows_the_cube_root_law_over_all_times(start, emissivity):
    law = radiative(emissivity=emissivity, surroundings=0.0)
    rate = 3.0 * B * emissivity * SURFACE / CAPACITY * start**3
    for growth in SHARES:
        expected = start * (1.0 + growth) ** (-1.0 / 3.0)
        assert exact(law, start, growth / rate) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("start", [1e-3, 300.0, 1e6])
@pytest.mark.parametrize("convection", [1e-6, 1.0, 1e6])
def test_with_convection_into_zero_kelvin_it_follows_its_closed_form(start, convection):
    """θ⁻³ = (θ₀⁻³ + c/h) exp(3ht) − c/h with c = Bε; long times of it used to hang."""
    law = radiative(surroundings=0.0, convection=convection, ambient=0.0)
    c = 0.5 * B / convection
    for share in SHARES[SHARES < 100.0]:
        time = share * CAPACITY / SURFACE / convection
        cube = start**-3 + c * -math.expm1(-3.0 * share)
        expected = math.exp(-share) * cube ** (-1.0 / 3.0)
        assert exact(law, start, time) == pytest.approx(expected, rel=1e-12)
    assert exact(law, start, 1e12 / convection) == 0.0
    assert exact(law, start, 1e300) == 0.0


@pytest.mark.parametrize("start", [0.0, 1e-3, 299.0, 1e6])
@pytest.mark.parametrize("ambient", [0.0, 1e-3, 300.0, 1e6])
def test_without_emissivity_the_distance_falls_exponentially(start, ambient):
    law = radiative(emissivity=0.0, convection=20.0, ambient=ambient)
    for share in SHARES:
        time = share * CAPACITY / SURFACE / 20.0
        expected = start + (start - ambient) * math.expm1(-share)
        error = 4.0 * math.ulp(max(start, ambient) if share > 0.4 else start)
        assert exact(law, start, time) == pytest.approx(expected, rel=1e-13, abs=error)


@pytest.mark.parametrize("start", [0.0, 1e-3, 300.0, 1e6])
@pytest.mark.parametrize("surroundings", [0.0, 300.0])
def test_without_emissivity_and_convection_nothing_cools(start, surroundings):
    """The time it takes divided by zero."""
    law = radiative(emissivity=0.0, surroundings=surroundings)
    for time in (0.0, 1e-12, 1.0, 1e300):
        assert exact(law, start, time) == start


TEMPERATURES = or_none(decades(-3, 6))
POWERS = st.floats(-12.0, 12.0)


@st.composite
def grains(draw):
    """A law, a starting temperature, and the time constant of the slowest part of the way."""
    law = radiative(
        draw(or_none(decades(-6, 0))),
        draw(TEMPERATURES),
        draw(or_none(decades(-6, 6))),
        draw(TEMPERATURES),
    )
    start = draw(TEMPERATURES)
    slowest = 4.0 * B * law.emissivity * min(start, law.equilibrium) ** 3 + law.convection
    return law, start, CAPACITY / SURFACE / slowest if slowest > 0.0 else 1.0


@examples(400)
@given(grains(), POWERS, POWERS)
def test_any_grain_nears_its_equilibrium_and_never_crosses_it(grain, first, second):
    law, start, constant = grain
    rest = law.equilibrium
    times = [0.0, *sorted(constant * 10.0**power for power in (first, second)), 1e300]
    passed = [exact(law, start, time) for time in times]
    rounding = 4.0 * math.ulp(max(start, rest))
    assert all(map(math.isfinite, passed))
    assert all(min(start, rest) <= theta <= max(start, rest) for theta in passed)
    away = [abs(theta - rest) for theta in passed]
    assert all(later <= earlier + rounding for earlier, later in itertools.pairwise(away))


@examples(400)
@given(grains(), POWERS, POWERS)
def test_any_grain_cools_in_two_intervals_as_much_as_in_one(grain, first, second):
    law, start, constant = grain
    times = [constant * 10.0**power for power in (first, second)]
    together = exact(law, start, times[0] + times[1])
    apart = exact(law, exact(law, start, times[0]), times[1])
    # Every e-fold adds its rounding; after 700 of them floats lose their digits.
    error = 1e-12 * abs(together - law.equilibrium)
    error += 8.0 * math.ulp(max(together, law.equilibrium)) + 1e-300
    assert abs(apart - together) <= error


@numba.njit(error_model="numpy")
def panels(law, temperature):
    """Panels from a temperature to where the distance to equilibrium is lost in rounding."""
    distance = temperature - law.equilibrium
    count = 0
    while abs(distance) > 1e-17 * law.equilibrium:
        if not panel_time(law, distance, PANEL) < math.inf:
            return -1
        distance *= math.exp(-PANEL)
        count += 1
    return count


@pytest.mark.parametrize("start", [0.0, 1.0, 1e6])
@pytest.mark.parametrize("rest", [2.0 * COLDEST, 1e-3, 3e5])
def test_the_way_to_equilibrium_is_a_bounded_number_of_panels(start, rest):
    law = radiative(surroundings=rest)
    most = math.ceil((math.log(max(start, rest) / rest) + 17.0 * math.log(10.0)) / PANEL) + 1
    assert 0 < panels(law, start) <= most <= 250
    assert exact(law, start, math.inf) == rest


QUARTIC = [QuarticCooling.Numbers(density, 10.0, 300.0) for density in (1e-3, 1e3, 1e9)]


@pytest.mark.parametrize("law", QUARTIC)
@pytest.mark.parametrize("excess", [1e-3, 1.0, 1e6])
def test_the_quartic_law_follows_the_cube_root_of_time_over_all_times(law, excess):
    rate = 3.0 * B / (law.density * law.heat_capacity) * excess**3
    for growth in SHARES:
        expected = 300.0 + excess * (1.0 + growth) ** (-1.0 / 3.0)
        # The excess is a difference of temperatures and has their rounding.
        error = 4.0 * math.ulp(300.0 + excess)
        assert exact(law, 300.0 + excess, growth / rate) == pytest.approx(expected, abs=error)


@examples(300)
@given(st.sampled_from(QUARTIC), decades(-3, 6), POWERS, POWERS)
def test_the_quartic_law_nears_its_start_in_two_intervals_as_in_one(law, excess, first, second):
    start = 300.0 + excess
    constant = law.density * law.heat_capacity / B / excess**3
    times = [constant * 10.0**power for power in (first, second)]
    together = exact(law, start, times[0] + times[1])
    apart = exact(law, exact(law, start, times[0]), times[1])
    assert 300.0 <= together <= start
    assert abs(apart - together) <= 1e-13 * (together - 300.0) + 8.0 * math.ulp(together)
