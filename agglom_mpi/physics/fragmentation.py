"""Fragmentation: when an aggregate breaks, and into how many pieces."""

import math
from typing import NamedTuple

from agglom_mpi.compilation.stages import Submodel, dispatch, inlined
from agglom_mpi.physics.pair import is_frame_dependent


class PairEnergyFragmentation(NamedTuple):
    """Each aggregate absorbs half of the kinetic energy that the pair dissipates; γ in J/m².

    The default reading: it does not depend on the frame.
    """

    surface_energy: float


class OwnEnergyFragmentation(NamedTuple):
    """Each aggregate absorbs |change of its own kinetic energy|, as published  [B 5.1]; γ in J/m².

    That depends on the frame of reference.
    """

    surface_energy: float


class FragmentCount(NamedTuple):
    """Number of equal pieces (1: it does not break) and the surface energy that they take, J."""

    pieces: int
    energy: float


@dispatch
def breakage(
    model: Submodel | None, pair_loss: float, own_change: float, radius: float, grains: int
) -> FragmentCount:
    """Pieces of one sphere after an impact that releases these energies.

    Parameters
    ----------
    model
        The scene's fragmentation law, None without one.
    pair_loss, own_change
        Kinetic energy that the pair dissipated and that this sphere lost itself, J.
    radius
        b₀ in m.
    grains
        Grains in it; a single grain does not break.
    """


@inlined
def equal_pieces(
    surface_energy: float, absorbed: float, radius: float, grains: int
) -> FragmentCount:
    """N = floor((1 + δK/(4πγb₀²))³) pieces, taking 4πγb₀²(n^⅓ − 1) in J  [B 5.1–5.3].

    δK is `absorbed` in J, γ `surface_energy` in J/m², b₀ `radius` in m. At most as many pieces as
    `grains`; after the floor they have radius b₀ n^(−1/3).
    """
    if grains < 2:
        return FragmentCount(1, 0.0)
    surface = 4.0 * math.pi * surface_energy * radius * radius
    most = float(grains)
    shrinkage = 1.0 + absorbed / surface
    count = most if shrinkage >= most else min(most, math.floor(shrinkage**3))
    if count < 2.0:
        return FragmentCount(1, 0.0)
    return FragmentCount(int(count), surface * (count ** (1.0 / 3.0) - 1.0))


@is_frame_dependent.register(PairEnergyFragmentation)
def _in_every_frame(model):
    return False


@is_frame_dependent.register(OwnEnergyFragmentation)
def _in_one_frame(model):
    return True


@breakage.register(None)
def _unbreakable(model, pair_loss, own_change, radius, grains):
    return FragmentCount(1, 0.0)


@breakage.register(PairEnergyFragmentation)
def _pair_energy(model, pair_loss, own_change, radius, grains):
    return equal_pieces(model.surface_energy, 0.5 * pair_loss, radius, grains)


@breakage.register(OwnEnergyFragmentation)
def _own_energy(model, pair_loss, own_change, radius, grains):
    return equal_pieces(model.surface_energy, abs(own_change), radius, grains)
