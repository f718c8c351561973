"""Breaking contact by contact: its onset, its end, and the energy that it takes."""

import math

import numpy as np
import pytest
from adhesive_contacts import first_touch, jkr_work, least_overlap

from agglom_mpi.physics.contact_breaking import ContactBreaking
from agglom_mpi.physics.fragmentation import breakage

RADIUS, ENERGY, MODULUS = 5e-7, 0.025, 54e9 / (2.0 * (1.0 - 0.17**2))
CONTACT = jkr_work(first_touch(), least_overlap()) * (
    (2.0 * ENERGY) ** 5 * (0.5 * RADIUS) ** 4 / MODULUS**2
) ** (1.0 / 3.0)
"""Work in J to part two grains, by the integral over the JKR curve."""


def broken(absorbed, grains, share=1.0):
    """Pieces of an aggregate that absorbs an energy in units of that of a contact."""
    law = ContactBreaking(youngs_modulus=54e9, poisson_ratio=0.17, energy_per_contact=share)
    numbers = law.build({"surface_energy": ENERGY})
    radius = RADIUS * grains ** (1.0 / 3.0)
    return breakage(numbers, 2.0 * absorbed * CONTACT, 0.0, radius, grains)


@pytest.mark.parametrize("grains", [2, 3, 100, 10**6])
def test_nothing_breaks_below_the_energy_of_a_contact_and_all_grains_part_at_that_of_all(grains):
    assert broken(0.999, grains) == (1, 0.0)
    assert broken(1.001, grains).pieces == 2
    assert broken(grains - 1.001, grains).pieces == max(1, grains - 1)
    assert broken(grains - 0.999, grains).pieces == grains
    assert broken(1e3 * grains, grains).pieces == grains


def test_a_single_grain_does_not_break():
    assert broken(1e9, 1) == (1, 0.0)


def test_each_contact_that_breaks_takes_its_work():
    for absorbed in (1.5, 7.5, 98.5):
        pieces, energy = broken(absorbed, 100)
        assert pieces == 1 + math.floor(absorbed)
        assert energy == pytest.approx((pieces - 1) * CONTACT, rel=1e-9)


def test_with_ten_times_the_energy_per_contact_all_grains_part_at_ten_times_that_of_all():
    assert broken(9.99, 100, 10.0).pieces == 1
    assert broken(10.0 * 98.9, 100, 10.0).pieces == 99
    found = broken(10.0 * 99.1, 100, 10.0)
    assert found.pieces == 100
    assert found.energy == pytest.approx(99.0 * CONTACT, rel=1e-9)


def test_pieces_never_fall_with_the_energy_over_all_decades_and_sizes():
    law = ContactBreaking(youngs_modulus=54e9)
    numbers = law.build({"surface_energy": ENERGY})
    for radius in np.geomspace(1e-9, 1e3, 13):
        found = [breakage(numbers, loss, 0.0, radius, 50) for loss in np.geomspace(1e-40, 1e40, 81)]
        pieces = [each.pieces for each in found]
        assert pieces == sorted(pieces)
        assert (pieces[0], pieces[-1]) == (1, 50)
        assert all(each.energy >= 0.0 for each in found)
