"""Cooling between impacts: exact solutions, their limits, and the published Euler steps."""

import itertools
import math
from decimal import Decimal, localcontext

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import agglom_mpi.compilation.kernels  # noqa: F401  (gives the formulas to Numba)
from agglom_mpi.physics.cooling import (
    SHORT,
    QuarticCooling,
    RadiativeCooling,
    equilibrium_temperature,
    euler_step,
    exact_temperature,
)

B = 5.670374419e-8
SURFACE = 4.0 * math.pi * 1e-3**2
CAPACITY = 2e-2
TIME = st.floats(-6.0, 6.0).map(lambda power: 10.0**power)
SETTINGS = settings(max_examples=150, deadline=None, derandomize=True)


@numba.njit(error_model="numpy")
def exact(law, temperature, time):
    return exact_temperature(law, temperature, SURFACE, CAPACITY, time)


@numba.njit(error_model="numpy")
def euler(law, temperature, step):
    return euler_step(law, temperature, SURFACE, CAPACITY, step)


def radiative(emissivity=0.5, surroundings=300.0, convection=0.0, ambient=300.0):
    rest = equilibrium_temperature(emissivity, surroundings, convection, ambient)
    return RadiativeCooling.Numbers(emissivity, surroundings, convection, ambient, rest)


def time_from(start, end, law):
    """Time in which pure radiation brings `start` to `end`, both on one side of θ_s.

    ∫dθ/(θ⁴ − s⁴) = [¼ ln((θ−s)/(θ+s)) − ½ atan(θ/s)]/s³.
    """
    s = law.surroundings

    def part(temperature):
        ratio = abs(temperature - s) / (temperature + s)
        return 0.25 * math.log(ratio) - 0.5 * math.atan(temperature / s)

    rate = B * law.emissivity * SURFACE / CAPACITY * s**3
    return (part(start) - part(end)) / rate


@pytest.mark.parametrize("start", [1.0, 100.0, 299.0, 301.0, 400.0, 1000.0, 3000.0])
def test_radiation_alone_follows_its_closed_form(start):
    law = radiative()
    for share in (1e-3, 0.1, 0.5, 0.9, 0.99, 0.9999):
        end = start + share * (300.0 - start)
        time = time_from(start, end, law)
        # The closed form loses digits where it subtracts logarithms of nearly the same numbers.
        assert exact(law, start, time) == pytest.approx(end, rel=1e-11)


@pytest.mark.parametrize(
    ("emissivity", "surroundings", "convection", "ambient"),
    [(0.5, 300.0, 10.0, 500.0), (1.0, 0.0, 25.0, 400.0), (0.1, 900.0, 3.0, 200.0)],
)
@pytest.mark.parametrize("start", [50.0, 450.0, 2000.0])
def test_radiation_with_convection_follows_a_numerical_solution(
    emissivity, surroundings, convection, ambient, start
):
    law = radiative(emissivity, surroundings, convection, ambient)

    def slope(_, theta):
        gain = B * emissivity * (theta**4 - surroundings**4) + convection * (theta - ambient)
        return -SURFACE / CAPACITY * gain

    times = [1e-2, 1.0, 10.0, 60.0, 300.0]
    reference = solve_ivp(
        slope, (0.0, 300.0), [start], method="DOP853", t_eval=times, rtol=1e-13, atol=1e-10
    )
    for time, temperature in zip(times, reference.y[0], strict=True):
        assert exact(law, start, time) == pytest.approx(temperature, rel=1e-11)


@pytest.mark.parametrize("start", [100.0, 299.999, 5000.0])
def test_convection_alone_is_exponential(start):
    law = radiative(emissivity=0.0, convection=20.0, ambient=300.0)
    for time in np.logspace(-6, 4, 21):
        distance = (start - 300.0) * math.exp(-20.0 * SURFACE / CAPACITY * time)
        assert exact(law, start, time) == pytest.approx(300.0 + distance, rel=1e-14)


def rk4(law, start, time, steps=8):
    """Temperature in 30 digits by Runge-Kutta steps of relative error below 1e-22 each."""
    with localcontext() as digits:
        digits.prec = 30
        emissivity, surroundings, convection, ambient = map(Decimal, law[:4])
        scale = Decimal(SURFACE) / Decimal(CAPACITY)

        def slope(theta):
            radiated = Decimal(B) * emissivity * (theta**4 - surroundings**4)
            return -scale * (radiated + convection * (theta - ambient))

        theta, step = Decimal(start), Decimal(time) / steps
        for _ in range(steps):
            a = slope(theta)
            b = slope(theta + step / 2 * a)
            c = slope(theta + step / 2 * b)
            d = slope(theta + step * c)
            theta += step / 6 * (a + 2 * b + 2 * c + d)
    return float(theta)


@pytest.mark.parametrize("share", [1e-6, 1e-3, 0.3, 0.999, 1.001, 3.0])
@pytest.mark.parametrize("start", [160.0, 290.0, 310.0, 4000.0])
@pytest.mark.parametrize("convection", [0.0, 20.0])
def test_short_times_are_followed_to_rounding_where_the_series_ends_and_beyond(
    start, share, convection
):
    law = radiative(convection=convection)
    rate = B * 0.5 * (start + 300.0) * (start**2 + 300.0**2) + convection
    time = share * SHORT / rate * CAPACITY / SURFACE
    assert exact(law, start, time) == pytest.approx(rk4(law, start, time), rel=4e-16)


@pytest.mark.parametrize("start", [1e-3, 300.0, 1e5])
def test_into_zero_kelvin_it_follows_the_cube_root_law(start):
    law = radiative(surroundings=0.0)
    rate = 3.0 * B * 0.5 * SURFACE / CAPACITY * start**3
    for growth in np.logspace(-12, 12, 25):
        expected = start * (1.0 + growth) ** (-1.0 / 3.0)
        assert exact(law, start, growth / rate) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("start", [0.0, 10.0, 299.0, 1e4])
@pytest.mark.parametrize("convection", [0.0, 5.0])
def test_after_any_time_it_is_at_equilibrium_and_after_none_where_it_was(start, convection):
    law = radiative(convection=convection, ambient=350.0)
    assert exact(law, start, 1e12) == pytest.approx(law.equilibrium, rel=1e-15)
    assert exact(law, start, 1e300) == law.equilibrium
    assert exact(law, start, 0.0) == start


@pytest.mark.parametrize("share", np.logspace(-12, 12, 25))
def test_times_from_far_below_to_far_above_the_time_constant_are_followed(share):
    law = radiative()
    start = 300.0 + 1e-3  # so near that the law is linear, to 1e-5 of the distance
    constant = CAPACITY / (4.0 * B * 0.5 * SURFACE * 300.0**3)
    cooled_by = start - exact(law, start, share * constant)
    rounding = 2.0 * math.ulp(300.0)
    assert cooled_by == pytest.approx(-1e-3 * math.expm1(-share), rel=1e-5, abs=rounding)


@SETTINGS
@given(st.floats(1.0, 3000.0), TIME, TIME, st.sampled_from([0.0, 1.0, 50.0]))
def test_two_intervals_cool_as_much_as_one(start, first, second, convection):
    law = radiative(convection=convection, ambient=500.0)
    together = exact(law, start, first + second)
    assert exact(law, exact(law, start, first), second) == pytest.approx(together, rel=1e-12)


@SETTINGS
@given(st.floats(0.0, 1e5), TIME, TIME, st.sampled_from([0.0, 1.0, 50.0]))
def test_equilibrium_is_approached_and_never_crossed(start, first, second, convection):
    law = radiative(convection=convection, ambient=500.0)
    earlier, later = sorted((first, second))
    distances = [
        (exact(law, start, time) - law.equilibrium) * math.copysign(1.0, start - law.equilibrium)
        for time in (0.0, earlier, later)
    ]
    rounding = 4.0 * math.ulp(max(start, law.equilibrium))
    assert distances[2] >= 0.0
    assert all(b <= a + rounding for a, b in itertools.pairwise(distances))


@pytest.mark.parametrize(
    "arguments", [(0.5, 300.0, 10.0, 600.0), (1.0, 900.0, 1e-3, 0.0), (1e-6, 10.0, 1e3, 1e4)]
)
def test_at_equilibrium_radiation_and_convection_balance(arguments):
    emissivity, surroundings, convection, ambient = arguments
    rest = equilibrium_temperature(*arguments)
    assert min(surroundings, ambient) <= rest <= max(surroundings, ambient)
    radiated = B * emissivity * (rest**4 - surroundings**4)
    scale = 4.0 * B * emissivity * rest**4 + convection * rest
    assert radiated + convection * (rest - ambient) == pytest.approx(0.0, abs=1e-14 * scale)


def test_equilibrium_without_one_of_the_two_is_the_others():
    assert equilibrium_temperature(0.5, 300.0, 0.0, 777.0) == 300.0
    assert equilibrium_temperature(0.0, 300.0, 1.0, 777.0) == 777.0
    assert equilibrium_temperature(0.5, 300.0, 1.0, 300.0) == 300.0


def errors_of_euler(law, start, time):
    """Errors of 1000, 2000, 4000 Euler steps against the exact solution."""
    errors = []
    for steps in (1000, 2000, 4000):
        temperature = start
        for _ in range(steps):
            temperature = euler(law, temperature, time / steps)
        errors.append(temperature - exact(law, start, time))
    return errors


@pytest.mark.parametrize(
    ("law", "time"), [(radiative(), 60.0), (QuarticCooling.Numbers(5000.0, 1000.0, 300.0), 1e5)]
)
def test_euler_steps_converge_to_the_exact_solution_with_first_order(law, time):
    errors = errors_of_euler(law, 900.0, time)
    assert abs(errors[0]) > 1e-6
    for coarse, fine in itertools.pairwise(errors):
        assert coarse / fine == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize(("share", "oscillates"), [(0.98, False), (1.02, True)])
def test_the_published_step_oscillates_near_the_surroundings_beyond_its_limit(share, oscillates):
    law = radiative()
    step = share * CAPACITY / (4.0 * B * 0.5 * SURFACE * 300.0**3)
    following = euler(law, 300.001, step)
    assert (following < 300.0) is oscillates
    assert exact(law, 300.001, step) > 300.0


def test_the_published_step_goes_below_zero_beyond_a_few_times_the_limit():
    law = radiative()
    step = 4.0 * CAPACITY / (4.0 * B * 0.5 * SURFACE * 600.0**3)
    assert euler(law, 600.0, 1.1 * step) < 0.0


@pytest.mark.parametrize("start", [301.0, 500.0, 2000.0])
def test_the_quartic_law_follows_a_numerical_solution(start):
    law = QuarticCooling.Numbers(5000.0, 1000.0, 300.0)
    rate = B / (5000.0 * 1000.0)
    times = np.array([1e-3, 0.1, 1.0, 10.0, 100.0]) / (rate * (start - 300.0) ** 3)
    reference = solve_ivp(
        lambda _, theta: -rate * (theta - 300.0) ** 4,
        (0.0, times[-1]),
        [start],
        method="DOP853",
        t_eval=times,
        rtol=1e-13,
        atol=1e-12,
    )
    for time, temperature in zip(times, reference.y[0], strict=True):
        assert exact(law, start, time) == pytest.approx(temperature, rel=1e-12)


@SETTINGS
@given(st.floats(300.0, 1e6), st.floats(-10.0, 30.0))
def test_neither_the_quartic_solution_nor_its_euler_step_crosses_the_start(temperature, power):
    law = QuarticCooling.Numbers(5000.0, 1000.0, 300.0)
    assert 300.0 <= exact(law, temperature, 10.0**power) <= temperature
    assert 300.0 <= euler(law, temperature, 10.0**power) <= temperature


def test_below_the_start_the_quartic_law_does_nothing():
    law = QuarticCooling.Numbers(5000.0, 1000.0, 300.0)
    assert exact(law, 250.0, 1e9) == 250.0
    assert euler(law, 250.0, 1e9) == 250.0
