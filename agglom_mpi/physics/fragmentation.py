"""Fragmentation: when an aggregate breaks, and into how many pieces."""

import math
from collections.abc import Mapping
from typing import ClassVar, Final, Literal, NamedTuple

from agglom_mpi.compilation.stages import formula, inlined
from agglom_mpi.declaration.laws import Group, Law
from agglom_mpi.declaration.needed import needed

FRAGMENTATION: Final = Group(
    "ρv²b/γ",
    "kinetic energy of an impact over surface energy",
    {"density": 1.0, "relative_speed": 2.0, "grain_radius": 1.0, "surface_energy": -1.0},
)


class FragmentCount(NamedTuple):
    """Number of equal pieces (1: it does not break) and the surface energy that they take, J."""

    pieces: int
    energy: float


class Fragmentation(Law):
    """Law of the breakage of aggregates; the variable `surface_energy` is γ in J/m²."""

    @needed
    def breakage(
        self, pair_loss: float, own_change: float, radius: float, grains: int
    ) -> FragmentCount:
        """Pieces of one sphere after an impact that releases these energies.

        Parameters
        ----------
        pair_loss, own_change
            Kinetic energy that the pair dissipated and that this sphere lost itself, J.
        radius
            b₀ in m.
        grains
            Grains in it; a single grain does not break.
        """
        raise NotImplementedError


class PairEnergyFragmentation(Fragmentation):
    """Each aggregate absorbs half of the kinetic energy that the pair dissipates.

    The default reading: it does not depend on the frame.
    """

    law: Literal["pair_energy"] = "pair_energy"
    summary: ClassVar[str] = "by the energy the pair lost [B 5.1-5.5]"
    variables = ("surface_energy",)
    groups = (FRAGMENTATION,)

    def breakage(self, pair_loss, own_change, radius, grains):
        """Pieces by half of the pair's loss."""
        return equal_pieces(self.surface_energy, 0.5 * pair_loss, radius, grains)


class OwnEnergyFragmentation(Fragmentation):
    """Each aggregate absorbs |change of its own kinetic energy|, as published  [B 5.1].

    That depends on the frame of reference.
    """

    law: Literal["own_energy"] = "own_energy"
    summary: ClassVar[str] = "by its own energy change, as published [B 5.1-5.5]"
    breaks: ClassVar[Mapping[str, str]] = {
        "frame": "as published, a sphere's own kinetic-energy change depends on the frame",
        "energy": "as published, its own change may be more than the pair loses",
    }
    variables = ("surface_energy",)
    groups = (FRAGMENTATION,)

    def breakage(self, pair_loss, own_change, radius, grains):
        """Pieces by the magnitude of its own change."""
        return equal_pieces(self.surface_energy, abs(own_change), radius, grains)

    def is_frame_dependent(self):
        """Return True: a sphere's own kinetic-energy change is."""
        return True


class NoFragmentation(Fragmentation):
    """Unbreakable aggregates."""

    law: Literal["none"] = "none"
    summary: ClassVar[str] = "unbreakable aggregates"
    is_absent = True

    def breakage(self, pair_loss, own_change, radius, grains):
        """One piece."""
        return FragmentCount(1, 0.0)


breakage = formula(Fragmentation, Fragmentation.breakage)


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
