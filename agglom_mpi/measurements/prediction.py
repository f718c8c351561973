"""Predictions of a string for each datum, from sums over its samples.

The distribution of a string is the pooled one: that of the particles of all of its samples
together. Each prediction is a function of sums over samples, so the same function gives the pooled
prediction and, from the sums without one sample each, the predictions of the jackknife.

Of quantiles the jackknife takes the change to first order: the change of the cumulative share at
the quantile, times the slope of the inverse over plus and minus the standard error of that share
(Woodruff, J. Am. Stat. Assoc. 47, 1952, 635; Francisco and Fuller, Ann. Stat. 19, 1991, 454). The
quantile without a sample would jump between the particles' sizes where few are left.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.measurements.census import Census
from agglom_mpi.measurements.datum import Datum, data_times

Floats = NDArray[np.float64]

QUANTILES: Final = {"d10": 0.1, "d50": 0.5, "d90": 0.9}
"""Share below each of the quantiles that can be measured."""


class Predictions(NamedTuple):
    """Predictions of a string for all values of some data, one after the other.

    Attributes
    ----------
    pooled
        By all samples, shape (Q,).
    left_out
        Without one sample each, shape (n, Q); nan with a single sample.
    """

    pooled: Floats
    left_out: Floats


def predictions(census: Census, data: Sequence[Datum]) -> Predictions:
    """Return what all samples of a string, and all but one, predict for each value of data.

    Parameters
    ----------
    census
        At least one sample, at the times of `data_times(data)`.
    data
        In any order.
    """
    times = data_times(data)
    if census.counts.shape[1] != len(times):
        raise ValueError(f"a census at {census.counts.shape[1]} times of data at {len(times)}")
    moments = [_Moment(census, index) for index in range(len(times))]
    with np.errstate(divide="ignore", invalid="ignore"):
        columns = [_column(moments[times.index(datum.time)], datum) for datum in data]
    rows = np.concatenate(columns, axis=1)
    if census.samples == 1:
        rows[1] = math.nan
    return Predictions(rows[0], rows[1:])


def _column(moment: "_Moment", datum: Datum) -> Floats:
    """Return the predictions of one datum, shape (1 + n, q): by all samples, then without one."""
    if datum.quantity == "sizes":
        return moment.shares(datum)
    if datum.quantity in QUANTILES:
        return moment.quantile(QUANTILES[datum.quantity], datum.weight)[:, None]
    return _NUMBERS[datum.quantity](moment, datum.weight)[:, None]


class _Moment:
    """Sums over samples at one time; the first row of each is of all, the others without one."""

    def __init__(self, census: Census, index: int) -> None:
        self.edges = census.edges
        self.grains = census.grains
        self.counts = census.counts[:, index]
        self.masses = census.masses[:, index]
        self.temperatures = census.temperatures[:, index]
        self.largest = census.largest[:, index]
        self.diameters = census.diameters[:, index]
        self.cubes_per_mass = 6.0 / (math.pi * census.density)
        self._amounts = {"number": self.counts, "mass": self.masses}

    def amounts(self, weight: str) -> Floats:
        """Return number, area/π in m² or mass in kg of each sample's particles, shape (n, B)."""
        if weight not in self._amounts:
            self._amounts[weight] = self.counts * self.diameters**2
        return self._amounts[weight]

    def power_sum(self, power: int) -> Floats:
        """Return the sums of dᵖ over the particles, in mᵖ, shape (1 + n,)."""
        if power < 3:
            return left_out_sums(np.einsum("sb,sb->s", self.counts, self.diameters**power))
        sums = np.einsum("sb,sb->s", self.masses, self.diameters ** (power - 3))
        return left_out_sums(self.cubes_per_mass * sums)

    def shares(self, datum: Datum) -> Floats:
        """Return the shares of the classes of a datum, shape (1 + n, q)."""
        assert datum.edges is not None
        classes = left_out_sums(
            self.amounts(datum.weight) @ class_fractions(self.edges, datum.edges)
        )
        return np.asarray(classes / np.sum(classes, axis=1, keepdims=True))

    def quantile(self, share: float, weight: str) -> Floats:
        """Return the diameter in m below which a share of the particles lies, shape (1 + n,)."""
        amounts = self.amounts(weight)
        pooled = np.sum(amounts, axis=0)
        if not np.sum(pooled) > 0.0:
            return np.full(1 + len(amounts), math.nan)
        middle = binned_quantile(self.edges, pooled, share)
        below = left_out_sums(amounts @ fractions_below(self.edges, np.array([middle]))[:, 0])
        shares = below / left_out_sums(np.sum(amounts, axis=1))
        changes = shares - shares[0]
        error = jackknife_error(shares[1:])
        if not error > 0.0:
            return np.full(1 + len(amounts), middle)
        low, high = max(share - error, 0.0), min(share + error, 1.0)
        ratio = binned_quantile(self.edges, pooled, high) / binned_quantile(self.edges, pooled, low)
        return np.asarray(middle * np.exp(-changes * math.log(ratio) / (high - low)))


def left_out_sums(values: Floats) -> Floats:
    """Return sums over samples, by all and without one each: shape (n, …) → (1 + n, …)."""
    total = np.sum(values, axis=0, keepdims=True)
    return np.concatenate([total, total - values])


def jackknife_error(left_out: Floats) -> float:
    """Return the standard error of a number by its values without one sample each, (n,)."""
    n = len(left_out)
    return math.sqrt((n - 1) / n * float(np.sum((left_out - np.mean(left_out)) ** 2)))


def fractions_below(edges: Floats, diameters: Floats) -> Floats:
    """Return the fraction of each bin below some diameters, linear in log size, shape (B, k)."""
    logs = np.log(edges)
    with np.errstate(divide="ignore"):
        places = np.log(diameters) - logs[:-1, None]
    return np.clip(places / np.diff(logs)[:, None], 0.0, 1.0)


def class_fractions(edges: Floats, class_edges: Floats) -> Floats:
    """Return the fraction of each bin in each class, shape (B, q); each row sums to 1.

    What is smaller than all classes belongs to the first, and what is larger to the last.
    """
    below = fractions_below(edges, class_edges[1:-1])
    return np.diff(np.pad(below, ((0, 0), (1, 1)), constant_values=((0, 0), (0, 1))), axis=1)


def binned_quantile(edges: Floats, amounts: Floats, share: float) -> float:
    """Return the diameter in m below which a share of the amounts of bins, (B,), lies.

    The cumulative share is linear in the logarithm of the diameter within a bin.
    """
    cumulative = np.cumsum(amounts)
    wanted = share * cumulative[-1]
    row = min(int(np.searchsorted(cumulative, wanted)), len(amounts) - 1)
    inside = 1.0 - (cumulative[row] - wanted) / amounts[row] if amounts[row] > 0.0 else 0.0
    low, high = edges[row], edges[row + 1]
    return float(low * (high / low) ** min(max(inside, 0.0), 1.0))


_MEAN_POWERS: Final = {"number": (1, 0), "area": (3, 2), "mass": (4, 3)}
"""Powers of the two sums whose ratio is the mean diameter by a weight."""


def _mean_diameter(moment: _Moment, weight: str) -> Floats:
    above, below = _MEAN_POWERS[weight]
    return moment.power_sum(above) / moment.power_sum(below)


def _spread(moment: _Moment, _: str) -> Floats:
    """Return the standard deviation of diameters over their mean, √(⟨d²⟩/⟨d⟩² − 1)."""
    ratio = moment.power_sum(2) * moment.power_sum(0) / moment.power_sum(1) ** 2
    return np.sqrt(np.maximum(ratio - 1.0, 0.0))


def _particles_left(moment: _Moment, _: str) -> Floats:
    n = len(moment.counts)
    samples = np.concatenate([[n], np.full(n, n - 1)])
    return moment.power_sum(0) / (samples * moment.grains)


def _largest_mass_fraction(moment: _Moment, _: str) -> Floats:
    masses = np.sum(moment.masses, axis=1)
    return left_out_sums(moment.largest) / left_out_sums(masses)


def _temperature(moment: _Moment, _: str) -> Floats:
    masses = np.sum(moment.masses, axis=1)
    return left_out_sums(moment.temperatures * masses) / left_out_sums(masses)


_NUMBERS: Final[dict[str, Callable[[_Moment, str], Floats]]] = {
    "d43": lambda moment, _: _mean_diameter(moment, "mass"),
    "d32": lambda moment, _: _mean_diameter(moment, "area"),
    "mean_diameter": _mean_diameter,
    "mean_radius": lambda moment, weight: 0.5 * _mean_diameter(moment, weight),
    "spread": _spread,
    "particles_left": _particles_left,
    "largest_mass_fraction": _largest_mass_fraction,
    "temperature": _temperature,
}
"""Prediction of each quantity of one number, shape (1 + n,)."""
