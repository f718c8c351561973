"""Breakage of aggregates: threshold, floor, cap by grains and the surface energy it takes."""

import math

import numba
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agglom_mpi.physics.fragmentation import (
    OwnEnergyFragmentation,
    PairEnergyFragmentation,
    breakage,
    equal_pieces,
)

SETTINGS = settings(max_examples=200, deadline=None, derandomize=True)


@numba.njit(error_model="numpy")
def pieces_of(surface_energy, absorbed, radius, grains):
    return equal_pieces(surface_energy, absorbed, radius, grains)


@numba.njit(error_model="numpy")
def broken(model, pair_loss, own_change, radius, grains):
    return breakage(model, pair_loss, own_change, radius, grains)


def energy_for(pieces, surface_energy, radius):
    """Energy that shrinks the fragment radius to b₀ n^(−1/3) [B 5.1–5.3]."""
    return 4.0 * math.pi * surface_energy * radius**2 * (pieces ** (1.0 / 3.0) - 1.0)


@pytest.mark.parametrize("pieces", [2, 3, 8, 27, 100])
@pytest.mark.parametrize("radius", [1e-6, 1e-2])
def test_the_number_of_pieces_is_rounded_down_at_its_threshold(pieces, radius):
    threshold = energy_for(pieces, 5.0, radius)
    above = pieces_of(5.0, threshold * (1.0 + 1e-9), radius, 1000)
    below = pieces_of(5.0, threshold * (1.0 - 1e-9), radius, 1000)
    assert above.pieces == pieces
    assert below.pieces == (pieces - 1 if pieces > 2 else 1)


@pytest.mark.parametrize("grains", [2, 3, 7])
def test_nothing_breaks_into_more_pieces_than_it_has_grains(grains):
    for absorbed in (energy_for(grains, 5.0, 1e-3) * 1.001, 1.0, 1e200):
        found = pieces_of(5.0, absorbed, 1e-3, grains)
        assert found.pieces == grains
        assert found.energy == pytest.approx(energy_for(grains, 5.0, 1e-3), rel=1e-13)


def test_a_single_grain_never_breaks():
    assert tuple(pieces_of(5.0, 1e300, 1e-3, 1)) == (1, 0.0)
    assert tuple(broken(PairEnergyFragmentation.Numbers(5.0), 1e300, 1e300, 1e-3, 1)) == (1, 0.0)


@SETTINGS
@given(
    st.floats(-6.0, 16.0), st.floats(-20.0, 10.0), st.floats(-6.0, -1.0), st.integers(2, 100_000)
)
def test_pieces_take_the_energy_of_their_new_surface_and_never_more_than_is_absorbed(
    surface_power, energy_power, radius_power, grains
):
    surface_energy, absorbed, radius = 10.0**surface_power, 10.0**energy_power, 10.0**radius_power
    found = pieces_of(surface_energy, absorbed, radius, grains)
    assert 1 <= found.pieces <= grains
    fragment = radius * found.pieces ** (-1.0 / 3.0)
    surface = 4.0 * math.pi * (found.pieces * fragment**2 - radius**2)
    scale = surface_energy * 4.0 * math.pi * radius**2
    assert found.energy == pytest.approx(surface_energy * surface, rel=1e-11, abs=1e-14 * scale)
    assert found.energy <= absorbed * (1.0 + 1e-12) + 1e-15 * scale


def test_the_two_laws_absorb_half_the_pair_loss_or_the_size_of_the_own_change():
    threshold = energy_for(4, 5.0, 1e-3) * 1.0001
    pair, own = PairEnergyFragmentation.Numbers(5.0), OwnEnergyFragmentation.Numbers(5.0)
    assert broken(pair, 2.0 * threshold, 0.0, 1e-3, 99).pieces == 4
    assert broken(pair, 1.99 * threshold, 1e9, 1e-3, 99).pieces == 3
    assert broken(own, 1e9, threshold, 1e-3, 99).pieces == 4
    assert broken(own, 0.0, -threshold, 1e-3, 99).pieces == 4
    assert broken(None, 1e9, 1e9, 1e-3, 99).pieces == 1
