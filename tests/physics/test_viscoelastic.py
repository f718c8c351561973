"""Restitution of viscoelastic spheres against the equation of motion of the contact."""

import math

import numpy as np
import pytest
from adhesive_contacts import viscoelastic_restitution
from contact_pairs import contact_pair

from agglom_mpi.physics.restitution import solve_restitution
from agglom_mpi.physics.viscoelastic import (
    MeasuredViscoelasticRestitution,
    ViscoelasticRestitution,
    pade_deficit,
)

GLASS = ViscoelasticRestitution(youngs_modulus=63e9, poisson_ratio=0.24, dissipative_constant=1e-8)


def deficit(law, pair):
    solution = solve_restitution(law.build({"density": 5000.0}), None, pair)
    assert not solution.bonds
    return solution.deficit


@pytest.mark.parametrize("root", [0.03, 0.1, 0.3, 0.5, 0.7, 0.9])
def test_restitution_is_within_a_hundredth_of_the_solution_of_the_equation_of_motion(root):
    exact = viscoelastic_restitution(root * root)
    assert 1.0 - pade_deficit(root) == pytest.approx(exact, rel=0.01)
    # Both have the series 1 − 1.15345 v*² + 0.798267 v*⁴ + …, whose next term is (4/15)v*⁵.
    assert abs(pade_deficit(root) - (1.0 - exact)) < root**5


@pytest.mark.parametrize("root", [1.0, 1.5, 2.0, 3.0, 6.0])
def test_for_any_speed_restitution_is_within_what_is_stated(root):
    assert abs(pade_deficit(root) - 1.0 + viscoelastic_restitution(root * root)) < 0.009


@pytest.mark.parametrize("radii", [(1e-3, 1e-3), (1e-6, 4e-6), (0.1, 1e-4)])
def test_restitution_of_a_pair_is_that_of_its_equation_of_motion(radii):
    pair = contact_pair(0.3, radii=radii)
    reduced = radii[0] * radii[1] / sum(radii)
    stiffness = 2.0 * 63e9 * math.sqrt(reduced) / (3.0 * (1.0 - 0.24**2))
    rate = (stiffness / pair.reduced_mass) ** 0.4
    damping = 1.5 * 1e-8 * rate * 0.3**0.2
    # ρ = 2Y√R/(3(1 − ν²)) of two spheres of one material  [R], which is (4/3)E*√R*.
    assert deficit(GLASS, pair) == pytest.approx(pade_deficit(math.sqrt(damping)), rel=1e-12)


def test_slow_impacts_lose_with_the_fifth_root_of_the_speed():
    slow, fast = (deficit(GLASS, contact_pair(w)) for w in (1e-9, 32e-9))
    assert fast / slow == pytest.approx(2.0, rel=1e-2)


def test_restitution_falls_with_speed_and_with_small_sizes_over_all_decades():
    speeds = np.geomspace(1e-9, 1e3, 61)
    for radius in np.geomspace(1e-9, 1e3, 25):
        found = [deficit(GLASS, contact_pair(w, radii=(radius, radius))) for w in speeds]
        assert np.all(np.diff(found) > 0.0)
        assert 0.0 < found[0] < found[-1] <= 1.0
    by_size = [deficit(GLASS, contact_pair(1.0, radii=(r, r))) for r in np.geomspace(1e-9, 1e3, 25)]
    assert np.all(np.diff(by_size) < 0.0)


def test_without_dissipation_impacts_are_elastic():
    law = GLASS.model_copy(update={"dissipative_constant": 0.0})
    assert deficit(law, contact_pair(1.0)) == 0.0


@pytest.mark.parametrize("e", [0.999999, 0.9, 0.5, 1e-3])
def test_a_measured_restitution_is_that_of_its_own_pair(e):
    law = MeasuredViscoelasticRestitution(restitution=e, speed=0.7, radius=1e-3)
    found = deficit(law, contact_pair(0.7, density=5000.0))
    assert 1.0 - found == pytest.approx(e, rel=1e-12)


@pytest.mark.parametrize(("speed", "radii"), [(0.01, (1e-3, 1e-3)), (3.0, (1e-5, 4e-4))])
def test_a_measured_restitution_gives_other_pairs_what_the_material_gives(speed, radii):
    e = 1.0 - deficit(GLASS, contact_pair(0.7, radii=(2e-3, 2e-3)))
    law = MeasuredViscoelasticRestitution(restitution=e, speed=0.7, radius=2e-3)
    pair = contact_pair(speed, radii=radii)
    assert deficit(law, pair) == pytest.approx(deficit(GLASS, pair), rel=1e-9)
