"""Measured data with the covariance of their errors, and the predictions of a string.

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
from agglom_mpi.measurements.census import Census, Censuses, SampleSums, census_of, sample_count
from agglom_mpi.measurements.quantities import PARTICLE_WEIGHTS, QUANTITIES, MeasuredQuantity
from agglom_mpi.statistics import Floats

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
    impacts
        Of `restitution`: approach speed in m/s, both radii in m, and temperature in K of each
        impact, nan for that of the grains, shape (q, 4).
    name, unit
        For people; the numbers of a datum are in SI units whatever its `unit` is.
    correlations
        Other data of one number each, and the correlation of its error with theirs.
    experiment
        Name of the experiment that it was measured in; empty where a campaign has none.

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
    impacts: Floats | None = None
    experiment: str = ""

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

    @property
    def kind(self) -> MeasuredQuantity:
        """The quantity with its unit and limits."""
        return QUANTITIES[self.quantity]

    @property
    def own_weight(self) -> str | None:
        """The weight; None of a quantity without one."""
        return self.weight if self.kind.has_weight else None

    @property
    def standard_errors(self) -> Floats:
        """Standard error of each value, shape (q,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def _check_edges(self) -> None:
        size = len(self.values)
        if self.kind.is_exact:
            if self.impacts is None or self.impacts.shape != (size, 4):
                raise ValueError(f"{size} values must have impacts of shape ({size}, 4)")
            return
        if not self.kind.is_curve:
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


def data_times(data: Sequence[Datum]) -> tuple[float | None, ...]:
    """Return the different times of data, ascending and the end last: the T times of a `Census`.

    Impacts have no time; the end stands alone where there is nothing else.
    """
    times = {datum.time for datum in data if not datum.kind.is_exact} or {None}
    ends: tuple[None, ...] = (None,) if None in times else ()
    return (*sorted(time for time in times if time is not None), *ends)


def exact_values(data: Sequence[Datum]) -> NDArray[np.bool_]:
    """Return which of all values, one datum after the other, follow without samples, (Q,)."""
    return np.repeat([d.kind.is_exact for d in data], [len(d.values) for d in data])


class Predictions(NamedTuple):
    """Predictions of a string for all values of some data, one after the other.

    Attributes
    ----------
    pooled
        By all samples, shape (Q,).
    left_out
        Without one sample each, shape (n, Q); nan of a single sample, but for exact values.
    """

    pooled: Floats
    left_out: Floats


def predictions(census: Censuses, data: Sequence[Datum]) -> Predictions:
    """Return what all samples of a string, and all but one, predict for each value of data.

    Parameters
    ----------
    census
        At least one sample, at the times of the data of each experiment, and perhaps at others.
    data
        In any order.

    Raises
    ------
    ValueError
        If there is no census at the time of a datum.
    """
    found: dict[int, Floats] = {}
    for experiment in experiments_of(data):
        own = [i for i, datum in enumerate(data) if datum.experiment == experiment]
        some = _predicted(census_of(census, experiment), [data[i] for i in own])
        found |= zip(own, some, strict=True)
    rows = np.column_stack([found[i] for i in range(len(data))])
    if sample_count(census) == 1:
        rows[1, ~exact_values(data)] = math.nan
    return Predictions(rows[0], rows[1:])


def experiments_of(data: Sequence[Datum]) -> tuple[str, ...]:
    """Return the names of the experiments of data, in their order."""
    return tuple(dict.fromkeys(datum.experiment for datum in data))


def _predicted(census: Census, data: Sequence[Datum]) -> list[Floats]:
    """Return the predictions for each datum of one experiment, (1 + n, q)."""
    times = census.times or tuple(_place(time) for time in data_times(data))
    if census.counts.shape[1] != len(times):
        raise ValueError(f"a census at {census.counts.shape[1]} times of data at {len(times)}")
    if absent := absent_time(times, data):
        raise ValueError(absent)
    wanted = {_place(datum.time) for datum in data if not datum.kind.is_exact}
    sums = {time: SampleSums(census, times.index(time)) for time in wanted or times[:1]}
    of_impacts = next(iter(sums.values()))
    with np.errstate(divide="ignore", invalid="ignore"):
        return [
            each.kind.predict(of_impacts, each.weight, each.impacts)
            if each.kind.is_exact
            else each.kind.predict(sums[_place(each.time)], each.weight, each.edges)
            for each in data
        ]


def absent_time(times: Sequence[float], data: Sequence[Datum]) -> str:
    """Return which time of data is not among those of a census; empty if all are."""
    for datum in data:
        if not datum.kind.is_exact and _place(datum.time) not in times:
            known = ", ".join("the end" if t == math.inf else f"{t:g} s" for t in times)
            asked = "the end" if datum.time is None else f"{datum.time:g} s"
            return f"no census was taken at {asked}; there are some at {known}"
    return ""


def _place(time: float | None) -> float:
    """Return the time of a datum as a census has it."""
    return math.inf if time is None else time
