"""What was measured: one number, or the shares of size classes, with the covariance of its errors.

All values are in SI units. `files.size_curve` makes shares and their covariance of what
laboratories report: a cumulative curve, a histogram, or single diameters.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.formatting import value_with_prefix

Floats = NDArray[np.float64]

PARTICLE_WEIGHTS: Final = ("number", "area", "mass")
"""What a particle counts by in a distribution: 1, its surface, or its mass."""


class MeasuredQuantity(NamedTuple):
    """A quantity that can be measured: its SI unit, whether it has a weight, and its maximum."""

    unit: str
    has_weight: bool
    summary: str
    most: float = math.inf


QUANTITIES: Final = {
    "sizes": MeasuredQuantity("1", True, "shares of classes of diameter"),
    "d10": MeasuredQuantity("m", True, "diameter below which 10 % lie"),
    "d50": MeasuredQuantity("m", True, "median diameter"),
    "d90": MeasuredQuantity("m", True, "diameter below which 90 % lie"),
    "d43": MeasuredQuantity("m", False, "De Brouckere mean diameter D[4,3]"),
    "d32": MeasuredQuantity("m", False, "Sauter mean diameter D[3,2]"),
    "mean_diameter": MeasuredQuantity("m", True, "mean diameter"),
    "mean_radius": MeasuredQuantity("m", True, "mean radius"),
    "spread": MeasuredQuantity(
        "1", False, "standard deviation of the diameters relative to their mean, by number"
    ),
    "particles_left": MeasuredQuantity(
        "1", False, "number of particles relative to that of the grains at the start", 1.0
    ),
    "largest_mass_fraction": MeasuredQuantity(
        "1", False, "mass of the largest particle relative to the total mass", 1.0
    ),
    "temperature": MeasuredQuantity("K", False, "mean temperature by mass"),
}
"""The quantities by name."""


MAX_SUM_ERROR: Final = 1e-6
"""Largest difference between the sum of the shares of a datum and 1."""


@dataclass(frozen=True, eq=False)
class Datum:
    """One measured quantity at one time.

    Parameters
    ----------
    quantity
        A key of `QUANTITIES`.
    values
        What was measured, shape (q,); for `sizes` the shares of the classes, which sum to 1; else
        one number.
    covariance
        Covariance of the errors of the measurement, shape (q, q). It may be singular, as that of
        shares is; directions without an error are not compared.
    weight
        One of `PARTICLE_WEIGHTS`; ignored by quantities without a weight.
    time
        In s; None: the end of the simulation.
    edges
        Diameters between the classes of `sizes` in m, shape (q + 1,), ascending; the first may be
        0 and the last inf. The first class has everything below it, and the last class everything
        above it, so that the shares of a simulation sum to 1 as well.
    name, unit
        For people; the numbers of a datum are in SI units whatever its `unit` is.
    correlations
        Other data of one number each, and the correlation of its error with theirs.

    Raises
    ------
    ValueError
        If these do not fit together.
    """

    quantity: str
    values: Floats
    covariance: Floats
    weight: str = "number"
    time: float | None = None
    edges: Floats | None = None
    name: str = ""
    unit: str = ""
    correlations: tuple[tuple["Datum", float], ...] = field(default=(), repr=False)

    @classmethod
    def of_value(
        cls,
        quantity: str,
        value: float,
        error: float,
        weight: str = "number",
        time: float | None = None,
        name: str = "",
        unit: str = "",
    ) -> Self:
        """Return the datum of one number and its standard error, both in SI units."""
        covariance = np.array([[float(error) ** 2]])
        return cls(quantity, np.array([float(value)]), covariance, weight, time, None, name, unit)

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise ValueError(f"quantity {self.quantity!r}; must be one of {', '.join(QUANTITIES)}")
        if self.weight not in PARTICLE_WEIGHTS:
            raise ValueError(
                f"weight {self.weight!r}; must be one of {', '.join(PARTICLE_WEIGHTS)}"
            )
        size = len(self.values)
        if self.covariance.shape != (size, size):
            shape = self.covariance.shape
            raise ValueError(f"covariance of shape {shape}; must be ({size}, {size}), as values")
        if not (np.all(np.isfinite(self.values)) and np.all(np.isfinite(self.covariance))):
            raise ValueError("values and covariance must be finite")
        if np.trace(self.covariance) <= 0.0:
            raise ValueError("error 0; must be above 0")
        self._check_edges()

    def _check_edges(self) -> None:
        size = len(self.values)
        if self.quantity != "sizes":
            if self.edges is not None or size != 1:
                raise ValueError(f"{self.quantity} has one value and no edges")
            return
        if size < 2:
            raise ValueError("one class; there must be at least two")
        if self.edges is None or len(self.edges) != size + 1:
            raise ValueError(f"{size} classes must have {size + 1} edges")
        if self.edges[0] < 0.0 or not np.all(np.diff(self.edges) > 0.0):
            raise ValueError("edges of classes must ascend from at least 0")
        if abs(float(np.sum(self.values)) - 1.0) > MAX_SUM_ERROR:
            raise ValueError(f"shares sum to {np.sum(self.values):.6g}; must sum to 1")


def datum_name(quantity: str, weight: str, time: float | None) -> str:
    """Return the name of a datum for people, as `d90 by mass at 2 ms`."""
    by = f" by {weight}" if QUANTITIES[quantity].has_weight else ""
    when = "the end" if time is None else value_with_prefix(time, "s")
    return f"{quantity}{by} at {when}"


def one_name(quantity: str, weight: str) -> tuple[str, str]:
    """Return quantity and weight by the one name of all that are proportional to each other.

    A mean radius is half of a diameter, and the mean diameters by area and by mass are D[3,2] and
    D[4,3]. A quantity without a weight is by number.
    """
    if quantity in ("mean_radius", "mean_diameter"):
        quantity = {"area": "d32", "mass": "d43"}.get(weight, "mean_diameter")
    return quantity, weight if QUANTITIES[quantity].has_weight else "number"


def within_limits(quantity: str, values: Floats, lengths: tuple[float, float]) -> Floats:
    """Return predicted values, (n, q), moved to the nearest ones that are possible.

    `lengths` are the smallest and the largest diameter of a particle in m. Shares keep their sum.
    """
    if QUANTITIES[quantity].unit == "m":
        factor = 0.5 if quantity == "mean_radius" else 1.0
        return np.clip(values, factor * lengths[0], factor * lengths[1])
    found = np.clip(values, 0.0, QUANTITIES[quantity].most)
    if quantity == "sizes":
        found *= values.sum(axis=1, keepdims=True) / found.sum(axis=1, keepdims=True)
    return found


def data_times(data: Sequence[Datum]) -> tuple[float | None, ...]:
    """Return the different times of data, ascending and the end last: the T times of a `Census`."""
    times = {datum.time for datum in data}
    ends: tuple[None, ...] = (None,) if None in times else ()
    return (*sorted(time for time in times if time is not None), *ends)
