"""Closed forms of the isothermal impact, MODEL §2."""

import math

import numpy as np
import pytest
from contact_pairs import contact_pair, isothermal_laws, pressure_scale

from agglom_mpi.physics.contact import CompressionRecoveryDuration, ContactArea, MeanSpeedDuration
from agglom_mpi.physics.impact_solvers import FixedPointIteration
from agglom_mpi.simulation.impact import solve_impact

PAIRS = [
    pytest.param((1e-3, 1e-3), id="equal"),
    pytest.param((1e-3, 4e-3), id="unequal"),
    pytest.param((3e-5, 1e-6), id="small"),
]
DECADES = np.logspace(-12, 0, 97)[:-1]


def approach_speed(laws, radii, x):
    """Approach speed at which I(e=0)/(2πb²H) is x."""
    return math.sqrt(x / pressure_scale(laws, contact_pair(1.0, radii=radii)))


@pytest.mark.parametrize("radii", PAIRS)
@pytest.mark.parametrize("length_ratio", [1.0, 1e-6])
def test_the_2004_law_gives_one_minus_the_root_of_the_pressure(radii, length_ratio):
    laws = isothermal_laws(
        CompressionRecoveryDuration.Numbers(length_ratio), ContactArea.Numbers(0.0, 1.0)
    )
    for x in DECADES:
        impact = solve_impact(laws, contact_pair(approach_speed(laws, radii, x), radii=radii))
        assert not impact.bonds
        assert not impact.capped
        assert impact.deficit == pytest.approx(math.sqrt(x), rel=1e-12)  # [B 4.14]
        assert impact.residual <= 1e-13


@pytest.mark.parametrize("radii", PAIRS)
@pytest.mark.parametrize("initial", [0.01, 0.0])
@pytest.mark.parametrize("final", [1.0, 0.3])
def test_the_2003_law_gives_its_closed_form(radii, initial, final):
    laws = isothermal_laws(MeanSpeedDuration.Numbers(1e-6), ContactArea.Numbers(initial, final))
    for x in DECADES * final:
        impact = solve_impact(laws, contact_pair(approach_speed(laws, radii, x), radii=radii))
        square = initial**2 - 8.0 * initial * x + 16.0 * final * x
        exact = 8.0 * x / (initial + 4.0 * x + math.sqrt(square))
        assert not impact.bonds
        assert impact.deficit == pytest.approx(exact, rel=1e-12)
        assert impact.residual <= 1e-13


def test_without_initial_area_the_2003_law_gives_the_ratio_of_roots():
    laws = isothermal_laws(MeanSpeedDuration.Numbers(1e-6), ContactArea.Numbers(0.0, 1.0))
    for x in DECADES:
        impact = solve_impact(
            laws, contact_pair(approach_speed(laws, (1e-3, 2e-3), x), radii=(1e-3, 2e-3))
        )
        root = math.sqrt(x)
        assert impact.deficit == pytest.approx(2.0 * root / (1.0 + root), rel=1e-12)


@pytest.mark.parametrize("final", [1.0, 0.3])
@pytest.mark.parametrize(
    "duration", [MeanSpeedDuration.Numbers(1e-6), CompressionRecoveryDuration.Numbers(1.0)]
)
@pytest.mark.parametrize("radii", PAIRS)
def test_a_pair_bonds_exactly_from_the_final_area_on(final, duration, radii):
    laws = isothermal_laws(duration, ContactArea.Numbers(0.01 * final, final))
    for excess, bonds in ((-1e-13, False), (1e-13, True), (-0.5, False), (1e6, True)):
        w = approach_speed(laws, radii, final * (1.0 + excess))
        assert solve_impact(laws, contact_pair(w, radii=radii)).bonds is bonds


@pytest.mark.parametrize("density", [1e3, 1e4])
@pytest.mark.parametrize("radius", [1e-6, 1e-2])
@pytest.mark.parametrize(
    "duration", [MeanSpeedDuration.Numbers(1e-6), CompressionRecoveryDuration.Numbers(1.0)]
)
def test_equal_spheres_bond_above_the_critical_approach_speed(density, radius, duration):
    final, hardness = 0.7, 3e7
    laws = isothermal_laws(duration, ContactArea.Numbers(0.0, final), hardness)
    critical = math.sqrt(6.0 * final * hardness * duration.length_ratio / density)
    for factor, bonds in ((1.0 - 1e-13, False), (1.0 + 1e-13, True)):
        pair = contact_pair(critical * factor, radii=(radius, radius), density=density)
        assert solve_impact(laws, pair).bonds is bonds


@pytest.mark.parametrize("x", [1e-6, 0.1, 0.9])
@pytest.mark.parametrize("cap", [2, 3, 10, 101])
def test_the_published_iteration_cycles_on_the_2004_law_and_says_so(x, cap):
    """G(e) = 1 − X/(1 − e): from e = 0 the iterates are 1 − X, 0, 1 − X, …"""
    solver = FixedPointIteration.Numbers(1e-10, cap)
    laws = isothermal_laws(
        CompressionRecoveryDuration.Numbers(1.0), ContactArea.Numbers(0.0, 1.0), solver=solver
    )
    impact = solve_impact(laws, contact_pair(approach_speed(laws, (1e-3, 1e-3), x)))
    assert impact.capped
    assert not impact.bonds
    assert impact.deficit == pytest.approx(x if cap % 2 else 1.0, rel=1e-12)
    assert impact.residual == pytest.approx(1.0 - x, rel=1e-12)


@pytest.mark.parametrize("x", [1e-9, 1e-7, 1e-6])
def test_the_published_iteration_converges_for_the_slowest_2003_impacts(x):
    """The derivative is −(1−e)[2/(1+e) + (a_f−a₀)/A(e)]: it contracts while e > 0.907."""
    area = ContactArea.Numbers(0.01, 1.0)
    laws = isothermal_laws(
        MeanSpeedDuration.Numbers(1e-6), area, solver=FixedPointIteration.Numbers(1e-13, 10_000)
    )
    impact = solve_impact(laws, contact_pair(approach_speed(laws, (1e-3, 1e-3), x)))
    exact = 8.0 * x / (0.01 + 4.0 * x + math.sqrt(1e-4 - 0.08 * x + 16.0 * x))
    assert exact < 1.0 - 0.907
    assert not impact.capped
    assert impact.deficit == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize("x", [0.01, 0.1, 0.5])
def test_the_published_iteration_ends_in_a_cycle_for_faster_2003_impacts(x):
    area = ContactArea.Numbers(0.01, 1.0)
    laws = isothermal_laws(
        MeanSpeedDuration.Numbers(1e-6), area, solver=FixedPointIteration.Numbers(1e-13, 1000)
    )
    impact = solve_impact(laws, contact_pair(approach_speed(laws, (1e-3, 1e-3), x)))
    assert impact.capped
    assert impact.residual > 0.01


def test_the_published_iteration_bonds_where_the_root_finder_does():
    area = ContactArea.Numbers(0.01, 1.0)
    laws = isothermal_laws(
        MeanSpeedDuration.Numbers(1e-6), area, solver=FixedPointIteration.Numbers(1e-10, 50)
    )
    for x, bonds in ((1.0 - 1e-12, False), (1.0 + 1e-12, True)):
        assert (
            solve_impact(laws, contact_pair(approach_speed(laws, (1e-3, 1e-3), x))).bonds is bonds
        )


def test_no_approach_is_elastic():
    for duration in (MeanSpeedDuration.Numbers(1e-6), CompressionRecoveryDuration.Numbers(1.0)):
        laws = isothermal_laws(duration, ContactArea.Numbers(0.01, 1.0))
        impact = solve_impact(laws, contact_pair(0.0))
        assert (impact.bonds, impact.deficit, impact.residual) == (False, 0.0, 0.0)
