"""The census of a string: how many particles of which mass its samples have in bins of size.

It is what a sample stores for the comparison with data. Everything that is predicted from it is
predicted from sums over samples, so the order of samples never matters.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MAX_BIN_RATIO: Final = 1.02
"""Maximum ratio of the upper to the lower edge of a bin."""


def census_edges(smallest: float, largest: float) -> Floats:
    """Return the edges of bins from the smallest to the largest diameter in m, shape (B + 1,).

    The bins are equally wide in the logarithm. Both diameters are in the middle of the outermost
    bins, so that grains of one size do not lie on an edge.
    """
    if not 0.0 < smallest <= largest < math.inf:
        raise ValueError(f"diameters from {smallest} to {largest} m; must be positive and ascend")
    steps = math.ceil(math.log(largest / smallest) / math.log(MAX_BIN_RATIO) * (1.0 - 1e-12))
    width = math.log(largest / smallest) / steps if steps else math.log(MAX_BIN_RATIO)
    return np.asarray(smallest * np.exp(width * (np.arange(steps + 2) - 0.5)))


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
