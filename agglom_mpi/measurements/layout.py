"""When the particles of a sample are counted, and in which classes of size; see `Census`."""

import math
from collections.abc import Mapping
from typing import Final, NamedTuple, Self, TypeAlias

import numpy as np

from agglom_mpi.statistics import Floats

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
    def edges(self) -> Floats:
        """Ends of the classes, diameters over twice the mean radius b⁰, shape (B + 1,)."""
        return np.exp(self.lower + CLASS_WIDTH * np.arange(self.classes + 1))


Layouts: TypeAlias = CensusLayout | Mapping[str, CensusLayout]
"""Layout of the censuses of a sample, or those of its experiments by name, as the file has them."""


def layout_of(layout: Layouts, experiment: str) -> CensusLayout:
    """Return the layout of an experiment; where a campaign has none, its own."""
    return layout if isinstance(layout, CensusLayout) else layout[experiment]


def prefix_of(experiment: str) -> str:
    """Return what the names of an experiment's columns and variables begin with."""
    return f"{experiment}."


def census_names(names: tuple[str, ...] | None) -> list[str]:
    """Return those of the columns of a sample that hold censuses, of all experiments."""
    return [name for name in names or () if name.rpartition(".")[2] in CENSUS_COLUMNS]
