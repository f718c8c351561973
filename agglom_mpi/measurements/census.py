"""Censuses: when particles are counted, in which classes of size, and how many of which mass.

It is what a sample stores for the comparison with data. Everything that is predicted from it is
predicted from sums over samples, so the order of samples never matters.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

CLASS_WIDTH: Final = math.log(1.02)
"""Width of a class, in the logarithm of the diameter."""

COUNTS, MASSES = "class_counts", "class_masses"
LARGEST, TEMPERATURES = "largest_masses", "census_temperatures"
CENSUS_COLUMNS: Final = COUNTS, MASSES, LARGEST, TEMPERATURES
"""Columns of a sample that hold its censuses."""


class CensusLayout(NamedTuple):
    """When censuses of a sample are taken, and in which classes.

    Attributes
    ----------
    times
        In s, ascending, shape (T,); inf stands for the end of a sample.
    lower
        Logarithm of the lower end of the first class, a diameter over twice the mean radius b⁰.
    classes
        Their number, B.
    """

    times: tuple[float, ...]
    lower: float
    classes: int

    @classmethod
    def between(cls, times: tuple[float, ...], smallest: float, largest: float) -> Self:
        """Return the layout for diameters between two, relative to twice the mean radius b⁰.

        A diameter of 1 is the middle of its class. Ends are whole classes away from it, so that
        they are the same on every machine.
        """
        below = max(0, math.ceil(-math.log(smallest) / CLASS_WIDTH - 0.5))
        above = max(0, math.ceil(math.log(largest) / CLASS_WIDTH - 0.5))
        return cls(times, -(below + 0.5) * CLASS_WIDTH, below + 1 + above)

    @property
    def bytes(self) -> int:
        """Size of the censuses of a sample: 4 and 8 bytes a class and time, 16 more a time."""
        return len(self.times) * (12 * self.classes + 16)

    @property
    def edges(self) -> NDArray[np.float64]:
        """Ends of the classes, diameters over twice the mean radius b⁰, shape (B + 1,)."""
        return np.exp(self.lower + CLASS_WIDTH * np.arange(self.classes + 1))


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
