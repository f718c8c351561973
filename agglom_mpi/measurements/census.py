"""The census of a string: how many particles of which mass its samples have in bins of size.

It is what a sample stores for the comparison with data. Everything that is predicted from it is
predicted from sums over samples, so the order of samples never matters.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Census:
    """Particles of the n samples of a string at T times in B bins of diameter.

    Parameters
    ----------
    edges
        Of the bins, in m, shape (B + 1,).
    counts
        Number of particles, shape (n, T, B).
    masses
        Mass of these particles in kg, shape (n, T, B).
    temperatures
        Mean temperature by mass in K, shape (n, T).
    largest
        Mass of the largest particle in kg, shape (n, T).
    grains
        Number of particles of a sample at the start.
    density
        Of the particles, in kg/m³.
    """

    edges: Floats
    counts: Floats
    masses: Floats
    temperatures: Floats
    largest: Floats
    grains: int
    density: float

    @property
    def samples(self) -> int:
        """Number of samples n."""
        return len(self.counts)

    @cached_property
    def diameters(self) -> Floats:
        """Diameter of the mean mass of the particles of a bin in m, shape (n, T, B); 0 if empty.

        It is exact where all particles of a bin are equal, as grains of one size and their
        agglomerates are. Else a mean diameter from it is off by less than a bin's width squared.
        """
        mean_mass = np.divide(
            self.masses, self.counts, out=np.zeros(self.masses.shape), where=self.counts > 0
        )
        return np.asarray(np.cbrt(6.0 / (math.pi * self.density) * mean_mass))
