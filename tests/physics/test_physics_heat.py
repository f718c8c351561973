"""Impulses, friction and heat of one impact: what is conserved and what is dissipated."""

import math

import numba
import pytest
from contact_pairs import R, constant_laws, contact_pair, laws_2003, laws_2004
from hypothesis import given, settings
from hypothesis import strategies as st

from agglom_mpi.physics.friction import ConstantFriction, RestitutionScaledFriction
from agglom_mpi.physics.heating import OwnEnergy, PairSplit, impact_heats, merge_heat
from agglom_mpi.simulation.impact import solve_impact

SETTINGS = settings(max_examples=150, deadline=None, derandomize=True)
SPEEDS = st.floats(1e-3, 1e3)
RADII = st.tuples(st.floats(1e-4, 1e-2), st.floats(1e-4, 1e-2))
FRAMES = st.tuples(st.floats(-100.0, 100.0), st.floats(-100.0, 100.0))


def after(pair, impact):
    """Return normal and tangential velocities of i and j after the impact."""
    normal, rubbing = impact.normal_impulse, impact.friction_impulse
    return (
        (pair.normal_i - normal / pair.mass_i, pair.tangent_i - rubbing / pair.mass_i),
        (pair.normal_j + normal / pair.mass_j, pair.tangent_j + rubbing / pair.mass_j),
    )


def kinetic_energy(pair, velocities):
    masses = (pair.mass_i, pair.mass_j)
    return sum(0.5 * m * (n * n + t * t) for m, (n, t) in zip(masses, velocities, strict=True))


def kinetic_energy_before(pair):
    before = ((pair.normal_i, pair.tangent_i), (pair.normal_j, pair.tangent_j))
    return kinetic_energy(pair, before)


@SETTINGS
@given(SPEEDS, SPEEDS, RADII, st.floats(0.0, 2.0), st.floats(0.01, 1.0), st.booleans())
def test_friction_never_reverses_the_slip_and_never_makes_energy(
    w, slip, radii, coefficient, restitution, scaled
):
    friction = (RestitutionScaledFriction if scaled else ConstantFriction).Numbers(coefficient)
    pair = contact_pair(w, slip, radii)
    impact = solve_impact(constant_laws(restitution, PairSplit.Numbers(), friction), pair)
    factor = 1.0 - restitution if scaled else 1.0
    coulomb = coefficient * factor * impact.normal_impulse
    stop = pair.reduced_mass * slip
    assert impact.friction_impulse == pytest.approx(min(coulomb, stop), rel=1e-12, abs=1e-300)
    (_, t_i), (_, t_j) = after(pair, impact)
    assert -1e-12 * slip <= t_i - t_j <= slip * (1.0 + 1e-12)
    normal_loss = 0.5 * pair.reduced_mass * w * w * (1.0 - restitution**2)
    assert impact.loss >= normal_loss * (1.0 - 1e-12)


@SETTINGS
@given(SPEEDS, SPEEDS, RADII, st.floats(0.0, 2.0), st.floats(0.01, 1.0))
def test_the_normal_impulse_reverses_the_approach_by_the_restitution(
    w, slip, radii, coefficient, restitution
):
    pair = contact_pair(w, slip, radii)
    impact = solve_impact(
        constant_laws(restitution, None, ConstantFriction.Numbers(coefficient)), pair
    )
    (n_i, _), (n_j, _) = after(pair, impact)
    assert n_j - n_i == pytest.approx(restitution * w, rel=1e-11)


@SETTINGS
@given(SPEEDS, SPEEDS, RADII, st.floats(0.0, 1.0), st.floats(0.0, 1e7), st.floats(0.0, 20.0))
def test_pair_split_closes_the_first_law_in_the_centre_of_mass_frame(
    w, slip, radii, coefficient, heat, softening
):
    laws = laws_2003(6e7, softening * R * 300.0, coefficient, heat)
    shares = radii[1] ** 3 / (radii[0] ** 3 + radii[1] ** 3)
    pair = contact_pair(w, slip, radii, frame=(-w * (1.0 - shares), -slip * (1.0 - shares)))
    impact = solve_impact(laws, pair)
    if impact.bonds:
        return
    before = kinetic_energy_before(pair)
    change = kinetic_energy(pair, after(pair, impact)) - before
    heats = impact.heat_i + impact.heat_j - impact.reaction
    assert impact.loss == pytest.approx(heats, rel=1e-12, abs=1e-12 * impact.reaction)
    assert impact.loss + change == pytest.approx(0.0, abs=1e-12 * before)
    area = (0.01 + 0.99 * impact.deficit) * math.pi * pair.radius**2
    assert impact.reaction == pytest.approx(2.0 * heat * area, rel=1e-12, abs=1e-300)


@SETTINGS
@given(SPEEDS, RADII, FRAMES, st.floats(0.01, 0.99))
def test_own_energy_books_seven_thirds_of_a_frictionless_loss_in_any_frame(
    w, radii, frame, restitution
):
    pair = contact_pair(w, 0.0, radii, frame=(frame[0] * w, frame[1] * w))
    impact = solve_impact(constant_laws(restitution, OwnEnergy.Numbers(), None), pair)
    scale = kinetic_energy_before(pair)
    expected = 7.0 / 3.0 * impact.loss
    assert impact.heat_i + impact.heat_j == pytest.approx(expected, abs=1e-12 * scale)


def test_own_energy_of_one_sphere_depends_on_the_frame():
    laws = constant_laws(0.5, OwnEnergy.Numbers(), None)
    rest, moving = (
        solve_impact(laws, contact_pair(2.0, 0.0, (1e-3, 2e-3), frame=(shift, 0.0)))
        for shift in (0.0, 10.0)
    )
    assert rest.loss == moving.loss
    # The kinetic energy ½m v² of i changes by J·V more in a frame that moves by V
    assert moving.heat_i - rest.heat_i == pytest.approx(10.0 * rest.normal_impulse, rel=1e-12)
    assert moving.heat_j - rest.heat_j == pytest.approx(-10.0 * rest.normal_impulse, rel=1e-12)


@pytest.mark.parametrize("frame", [(0.0, 0.0), (10.0, -3.0)])
def test_own_energy_heats_are_those_of_the_paper(frame):
    """½m(v² − v'²) + δW of each sphere, δW = m*w²(1−e²)/3 [B 4.7–4.9, 6.5–6.10]."""
    pair = contact_pair(2.0, 1.0, (1e-3, 2e-3), frame=frame)
    impact = solve_impact(
        constant_laws(0.5, OwnEnergy.Numbers(), ConstantFriction.Numbers(0.1)), pair
    )
    work = pair.reduced_mass * 4.0 * 0.75 / 3.0
    (n_i, t_i), (n_j, t_j) = after(pair, impact)
    own_i = 0.5 * pair.mass_i * (pair.normal_i**2 + pair.tangent_i**2 - n_i**2 - t_i**2)
    own_j = 0.5 * pair.mass_j * (pair.normal_j**2 + pair.tangent_j**2 - n_j**2 - t_j**2)
    assert impact.heat_i == pytest.approx(own_i + work, rel=1e-11)
    assert impact.heat_j == pytest.approx(own_j + work, rel=1e-11)


@numba.njit(error_model="numpy")
def bounce_heats(heating, friction, pair):
    return impact_heats(heating, friction, pair, 1.0)


@numba.njit(error_model="numpy")
def heat_of_merge(heating, pair):
    return merge_heat(heating, pair)


@pytest.mark.parametrize("heating", [PairSplit.Numbers(), OwnEnergy.Numbers()])
def test_restitution_one_loses_nothing(heating):
    for radii in ((1e-3, 1e-3), (1e-5, 1e-2)):
        pair = contact_pair(7.0, 3.0, radii)
        impact = solve_impact(constant_laws(1.0, heating, None), pair)
        assert impact.loss == 0.0
        total = impact.heat_i + impact.heat_j
        assert total == pytest.approx(0.0, abs=1e-14 * kinetic_energy_before(pair))


@SETTINGS
@given(SPEEDS, SPEEDS, RADII)
def test_the_2004_laws_conserve_momentum_and_only_lose_kinetic_energy(w, slip, radii):
    pair = contact_pair(w, slip, radii)
    impact = solve_impact(laws_2004(hardness=1e9), pair)
    if impact.bonds:
        return
    velocities = after(pair, impact)
    masses = (pair.mass_i, pair.mass_j)
    momentum = sum(m * n for m, (n, _) in zip(masses, velocities, strict=True))
    assert momentum == pytest.approx(pair.mass_i * w, rel=1e-12)
    change = kinetic_energy(pair, velocities) - kinetic_energy_before(pair)
    assert change == pytest.approx(-impact.loss, abs=1e-12 * kinetic_energy_before(pair))
    assert impact.loss >= 0.0


@pytest.mark.parametrize("heating", [PairSplit.Numbers(), OwnEnergy.Numbers()])
@SETTINGS
@given(SPEEDS, SPEEDS, RADII, FRAMES)
def test_a_merge_heats_like_a_bounce_after_which_nothing_moves_apart(
    heating, w, slip, radii, frame
):
    pair = contact_pair(w, slip, radii, frame=frame)
    sticks = ConstantFriction.Numbers(
        1.01 * slip / w
    )  # at e = 0 the Coulomb impulse just stops the slip
    bounce = sum(bounce_heats(heating, sticks, pair))
    # A sphere's own loss is a difference of kinetic energies, which grow with the frame's speed.
    rounding = 1e-13 * max(pair.mass_i, pair.mass_j) * sum(map(abs, (w, slip, *frame))) ** 2
    assert heat_of_merge(heating, pair) == pytest.approx(bounce, rel=1e-12, abs=rounding)
