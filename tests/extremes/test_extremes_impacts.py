"""Single impacts at extremes: decided like exact numbers, solved or bonded, never capped."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from contact_pairs import R, contact_pair, isothermal_laws, pressure_scale
from extreme_impacts import (
    CLOSED,
    EPSILON,
    MAX_STEPS,
    assert_sound,
    examples,
    excess_of,
    folded_impacts,
    highest_fold,
    impacts,
    make_2003,
    make_2004,
    make_own_energy,
    rounding_of_log_ratio,
    softening_of,
    walk,
)
from hypothesis import assume, given
from hypothesis import strategies as st

from agglom_mpi.physics.contact import CompressionRecoveryDuration, ContactArea, MeanSpeedDuration
from agglom_mpi.simulation.impact import solve_impact

pytestmark = pytest.mark.plain

KINDS = pytest.mark.parametrize("make", CLOSED)
ALL_KINDS = pytest.mark.parametrize("make", [*CLOSED, make_own_energy])
DURATIONS = pytest.mark.parametrize(
    "duration",
    [MeanSpeedDuration.Numbers(1e-6), CompressionRecoveryDuration.Numbers(1.0)],
    ids=["2003", "2004"],
)
SHARES = pytest.mark.parametrize("share", [0.1, pytest.param(1, marks=pytest.mark.slow)])
"""Of the examples that the slow tier draws."""
ULPS = range(-30, 31)


def steps_apart(value, ulps):
    for _ in range(abs(ulps)):
        value = math.nextafter(value, math.copysign(math.inf, ulps))
    return value


def exact_pressure(laws, pair):
    """X = m*w²/(2εb)/(2πb²H) of these floats, π as the float, without any rounding."""
    w, b, ratio = map(Fraction, (pair.approach_speed, pair.radius, laws.duration.length_ratio))
    force = Fraction(pair.reduced_mass) * w * w / (2 * ratio * b)
    return force / (2 * Fraction(math.pi) * b * b * Fraction(laws.hardness.hardness))


@DURATIONS
@pytest.mark.parametrize("radii", [(1e-3, 1e-3), (1e-9, 1e-6), (300.0, 0.7)])
@pytest.mark.parametrize("hardness", [1e-3, 0.1234, 1e15])
def test_beside_the_marginal_pressure_bonding_is_decided_as_by_exact_numbers(
    duration, radii, hardness
):
    laws = isothermal_laws(duration, ContactArea.Numbers(0.0, 1.0), hardness)
    critical = 1.0 / math.sqrt(pressure_scale(laws, contact_pair(1.0, radii=radii)))
    rounding = 4 * Fraction(EPSILON)  # eight products and quotients, half an ulp each
    decided = []
    for ulps in ULPS:
        pair = contact_pair(steps_apart(critical, ulps), radii=radii)
        bonds = solve_impact(laws, pair).bonds
        excess = exact_pressure(laws, pair) - 1
        if abs(excess) > rounding:
            assert bonds == (excess >= 0)
            decided.append(bonds)
    assert len(decided) >= len(ULPS) - 12
    assert any(decided)
    assert not all(decided)


def exact_log_ratio(laws, pair):
    """Ln r of an e = 0 bounce in extended precision; heat shared by the pair  [A 14–17]."""
    m, w, slip, b = map(
        np.longdouble, (pair.reduced_mass, pair.approach_speed, pair.slip_speed, pair.radius)
    )
    rubbing = min(np.longdouble(laws.friction.friction) * m * w, m * slip)
    area = np.longdouble(math.pi) * b * b
    loss = m * w * w / 2 + slip * rubbing - rubbing * rubbing / (2 * m)
    heat = loss / 2 + np.longdouble(laws.reaction.reaction_heat) * area
    capacity = np.longdouble(laws.heat_capacity)
    temperature = max(
        np.longdouble(pair.temperature_i) + heat / (np.longdouble(pair.mass_i) * capacity),
        np.longdouble(pair.temperature_j) + heat / (np.longdouble(pair.mass_j) * capacity),
    )
    force = m * w * w / (2 * np.longdouble(laws.duration.length_ratio) * b)
    hardening = np.longdouble(laws.hardness.activation_energy) / (np.longdouble(R) * temperature)
    return np.log(force / (2 * area * np.longdouble(laws.hardness.hardness))) - hardening


@KINDS
@pytest.mark.parametrize("softening", [1e-6, 1.0, 30.0, 600.0])
@pytest.mark.parametrize("heat", [0.0, 1e6])
def test_beside_the_marginal_pressure_softened_bonding_is_decided_as_by_finer_numbers(
    make, softening, heat
):
    pair = contact_pair(3.0, 2.0, (1e-3, 4e-3), (290.0, 310.0))
    laws = make(hardness=1.0, energy=softening * R * 290.0, heat=heat, initial=0.0)
    critical = float(np.exp(exact_log_ratio(laws, pair)))
    # The exponent is rounded a few times, and so is every temperature in it.
    rounding = 4.0 * EPSILON * (1.0 + 4.0 * softening)
    decided = []
    for ulps in itertools.chain(ULPS, (-(10**4), 10**4)):
        hardness = laws.hardness._replace(hardness=critical * (1.0 + ulps * EPSILON))
        beside = laws._replace(hardness=hardness)
        excess = exact_log_ratio(beside, pair)
        if abs(excess) > rounding:
            assert solve_impact(beside, pair).bonds == (excess >= 0)
            decided.append(excess >= 0)
    assert len(decided) >= 2
    assert any(decided)
    assert not all(decided)


@DURATIONS
@pytest.mark.parametrize("initial", [0.0, 0.01])
def test_just_short_of_bonding_restitution_goes_to_zero_with_its_closed_form(duration, initial):
    laws = isothermal_laws(duration, ContactArea.Numbers(initial, 1.0))
    scale = pressure_scale(laws, contact_pair(1.0))
    for short in np.logspace(-15, -1, 57):
        impact = solve_impact(laws, contact_pair(math.sqrt((1.0 - short) / scale)))
        x = 1.0 - short
        if isinstance(duration, MeanSpeedDuration.Numbers):
            square = initial**2 - 8.0 * initial * x + 16.0 * x
            exact = 8.0 * x / (initial + 4.0 * x + math.sqrt(square))
        else:
            span = 1.0 - initial
            exact = 2.0 * x / (initial + math.sqrt(initial**2 + 4.0 * span * x))
        assert not impact.bonds
        assert 1.0 - impact.deficit == pytest.approx(1.0 - exact, abs=2e-14)


@KINDS
@SHARES
def test_impacts_of_any_size_are_sound(make, share):
    @examples(300 * share)
    @given(impacts(make))
    def check(case):
        assert_sound(*case, solve_impact(*case))

    check()


CORNERS = list(
    itertools.product(
        (0.0, 1e-12, 1.0, 1e8),  # approach speed, m/s
        (1e-3, 1e6),  # temperature, K
        (1e-6, 4.0, 1e6),  # U/(Rθ)
        (1e-3, 1e15),  # hardness, Pa
        ((1e-9, 1e-9), (1e-9, 1e-6), (1e3, 1.0)),  # radii, m: mass ratios up to 1e9
        (0.0, 1e5),  # rise of temperature by reaction, K
        (0.0, 10.0),  # friction
    )
)


@KINDS
@pytest.mark.parametrize("initial", [0.0, 0.1])
def test_impacts_with_everything_at_an_extreme_are_sound(make, initial):
    capacity = 1000.0
    for w, temperature, softening, hardness, radii, rise, friction in CORNERS:
        pair = contact_pair(w, 3.0 * w, radii, (temperature, 2.0 * temperature))
        lighter = min(pair.mass_i, pair.mass_j)
        laws = make(
            hardness=hardness,
            energy=softening * R * temperature,
            friction=friction,
            heat=rise * lighter * capacity / (math.pi * pair.radius**2),
            capacity=capacity,
            initial=initial,
        )
        assert_sound(laws, pair, solve_impact(laws, pair))


@ALL_KINDS
@SHARES
def test_no_impact_needs_many_steps(make, share):
    @examples(200 * share)
    @given(impacts(make))
    def check(case):
        assert walk(*case)[1] <= MAX_STEPS
        assert not solve_impact(*case).capped

    check()


SCAN = -np.concatenate([[0.0], np.logspace(-9.0, 2.0, 4001)])
"""Ln d from that of e = 0 down, finer where impacts are slowest to part."""


@KINDS
@SHARES
def test_no_root_of_less_restitution_is_passed_over(make, share):
    """Everywhere above the deficit that was found the pressure asks for a smaller one."""

    @examples(200 * share)
    @given(impacts(make, softening=(0.0, 4.0)))
    def check(case):
        laws, pair = case
        assume(pair.approach_speed > 0.0)
        impact = solve_impact(laws, pair)
        if impact.bonds:
            assert float(excess_of(laws, pair, 0.0)) >= -rounding_of_log_ratio(laws, pair)
            return
        found = math.log(impact.deficit) if impact.deficit > 0.0 else -math.inf
        above = SCAN[found < SCAN]
        assert np.all(excess_of(laws, pair, above) <= rounding_of_log_ratio(laws, pair))

    check()


@ALL_KINDS
@SHARES
def test_beside_a_fold_the_impact_ends_there_or_far_beyond_as_the_fold_says(make, share):
    @examples(150 * share)
    @given(folded_impacts(make))
    def check(case):
        assume(case is not None)
        laws, pair, place, excess = case
        impact = solve_impact(laws, pair)
        assert not impact.bonds
        assert not impact.capped
        assert walk(laws, pair)[1] <= MAX_STEPS
        found = math.log(impact.deficit) if impact.deficit > 0.0 else -math.inf
        if excess > 0.0:  # two roots beside the fold, the smaller restitution above it
            assert place <= found <= 0.0
        else:
            assert found < place

    check()


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
@pytest.mark.parametrize("softening", [20.0, 80.0, 1000.0])
@ALL_KINDS
def test_a_fold_that_nearly_touches_is_passed_in_few_steps(make, softening, gap):
    """Bounds of ln r that are not bounds of its slope took 2e4 steps at 1e-6, the cap at 1e-10."""
    pair = contact_pair(100.0, temperatures=(100.0, 100.0), frame=(-50.0, 0.0))
    options = {"energy": softening * R * 100.0, "friction": 0.0, "heat": 0.0, "capacity": 10.0}
    laws = make(hardness=1.0, initial=0.0, **options)
    place, top, _ = highest_fold(laws, pair)
    laws = make(hardness=math.exp(top + gap), initial=0.0, **options)
    logarithm, steps = walk(laws, pair)
    assert steps <= 100
    assert logarithm < place - 1.0
    assert math.log(solve_impact(laws, pair).deficit) == pytest.approx(logarithm, rel=1e-14)


@KINDS
def test_partners_of_two_temperatures_may_be_swapped_to_the_bit(make):
    """The bound of the second partner was that of the way left by the first."""
    temperatures = (1.0, 1.1547819846894583)
    base = 183.0794482734816 if make is make_2003 else 183.0794482734816e-6
    laws = make(hardness=base, energy=10.0 * R, friction=0.0, heat=0.0, capacity=1.0, initial=0.0)
    one, other = (
        solve_impact(laws, contact_pair(1.0, 0.0, (1.0, 1.0), order, 1.0))
        for order in (temperatures, temperatures[::-1])
    )
    assert other == one


@KINDS
@SHARES
def test_the_partners_may_be_swapped(make, share):
    @examples(150 * share)
    @given(impacts(make))
    def check(case):
        laws, pair = case
        swapped = pair._replace(
            mass_i=pair.mass_j,
            mass_j=pair.mass_i,
            temperature_i=pair.temperature_j,
            temperature_j=pair.temperature_i,
            normal_i=-pair.normal_j,
            normal_j=-pair.normal_i,
            tangent_i=-pair.tangent_j,
            tangent_j=-pair.tangent_i,
        )
        impact = solve_impact(laws, pair)
        expected = impact._replace(heat_i=impact.heat_j, heat_j=impact.heat_i)
        assert solve_impact(laws, swapped) == expected

    check()


def in_units(laws, pair, length, mass, time, kelvin):
    """The same impact in numbers of other units."""
    speed, energy = length / time, mass * length**2 / time**2
    laws = laws._replace(
        hardness=laws.hardness._replace(
            hardness=laws.hardness.hardness * energy / length**3,
            activation_energy=laws.hardness.activation_energy * kelvin,  # U/R is a temperature
        ),
        reaction=laws.reaction._replace(
            reaction_heat=laws.reaction.reaction_heat * energy / length**2
        ),
        heat_capacity=laws.heat_capacity * energy / (mass * kelvin),
    )
    factors = {
        "approach_speed": speed,
        "slip_speed": speed,
        "mass_i": mass,
        "mass_j": mass,
        "reduced_mass": mass,
        "radius": length,
        "temperature_i": kelvin,
        "temperature_j": kelvin,
        "normal_i": speed,
        "normal_j": speed,
        "tangent_i": speed,
        "tangent_j": speed,
    }
    scaled = {name: getattr(pair, name) * factor for name, factor in factors.items()}
    return laws, pair._replace(**scaled)


POWERS = st.integers(-30, 30).map(lambda power: 2.0**power)


@ALL_KINDS
@SHARES
def test_in_units_of_powers_of_two_an_impact_is_the_same_to_the_bit(make, share):
    """The logarithms of pressure and hardness, taken apart, depended on the units."""

    @examples(150 * share)
    @given(impacts(make), POWERS, POWERS, POWERS, POWERS)
    def check(case, length, mass, time, kelvin):
        laws, pair = case
        assume(math.isfinite(softening_of(laws, pair)))
        impact = solve_impact(laws, pair)
        energy = mass * length**2 / time**2
        expected = impact._replace(
            normal_impulse=impact.normal_impulse * mass * length / time,
            friction_impulse=impact.friction_impulse * mass * length / time,
            heat_i=impact.heat_i * energy,
            heat_j=impact.heat_j * energy,
            reaction=impact.reaction * energy,
            loss=impact.loss * energy,
        )
        assert solve_impact(*in_units(laws, pair, length, mass, time, kelvin)) == expected

    check()


@KINDS
def test_a_deficit_too_small_for_a_float_is_an_elastic_impact_without_residual(make):
    """Without initial area, G of that restitution read as 0, and the residual as 1."""
    laws = make(hardness=1e15, energy=1e6 * R * 1e-3, friction=0.0, heat=0.0, initial=0.0)
    impact = solve_impact(laws, contact_pair(1e-12, temperatures=(1e-3, 1e-3)))
    assert (impact.bonds, impact.deficit, impact.residual) == (False, 0.0, 0.0)


def test_where_a_deficit_nears_the_smallest_float_its_residual_stays_small():
    """The pressure on so small a contact area overflowed, and the residual read 1."""
    laws = make_2004(
        hardness=0.3289492254255265,
        energy=2629263.93932065,
        friction=0.0,
        heat=0.0,
        capacity=3.162277660168379e-06,
    )
    impact = solve_impact(laws, contact_pair(1.0, temperatures=(100.0, 100.0)))
    assert not impact.bonds
    assert impact.deficit < 1e-300
    assert impact.residual < 1e-300


def test_at_mass_ratios_of_a_billion_the_heavy_partner_hardly_warms():
    laws = make_2003(hardness=1e12, heat=0.0)
    pair = contact_pair(10.0, 5.0, (1e-6, 1e-3))
    impact = solve_impact(laws, pair)
    assert pair.mass_j / pair.mass_i == pytest.approx(1e9, rel=1e-12)
    assert_sound(laws, pair, impact)
    warm_i, warm_j = impact.heat_i / pair.mass_i, impact.heat_j / pair.mass_j
    assert warm_i / warm_j == pytest.approx(1e9, rel=1e-12)
