"""The census of a string: how many particles of which mass its samples have in bins of size.

It is what a sample stores for the comparison with data.

The distribution of a string is the pooled one: that of the particles of all of its samples
together. Each prediction is a function of sums over samples, so the same function gives the pooled
prediction and, from the sums without one sample each, the predictions of the jackknife.

Of quantiles the jackknife takes the change to first order: the change of the cumulative share at
the quantile, times the slope of the inverse over plus and minus the standard error of that share
(Woodruff, J. Am. Stat. Assoc. 47, 1952, 635; Francisco and Fuller, Ann. Stat. 19, 1991, 454). The
quantile without a sample would jump between the particles' sizes where few are left.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from agglom_mpi.statistics import Floats


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
    coefficients
        Returns the coefficients of restitution of impacts, (q, 4) as of `Datum`, shape (q,); None
        where no impacts are compared.
    times
        The T times in s, inf at the end; None: those of the data that it is compared with.
    """

    edges: Floats
    counts: Floats
    masses: Floats
    temperatures: Floats
    largest: Floats
    grains: int
    density: float
    coefficients: Callable[[Floats], Floats] | None = None
    times: tuple[float, ...] | None = None

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


Censuses: TypeAlias = Census | Mapping[str, Census]
"""Census of the n samples of a string, or those of their experiments by name."""


def census_of(census: Censuses, experiment: str) -> Census:
    """Return the census of an experiment; where a campaign has none, its own."""
    return census if isinstance(census, Census) else census[experiment]


def sample_count(census: Censuses) -> int:
    """Return the number of samples n."""
    return census.samples if isinstance(census, Census) else next(iter(census.values())).samples


class SampleSums:
    """Sums over samples at one time; the first row of each is of all, the others without one."""

    def __init__(self, census: Census, index: int) -> None:
        self.edges = census.edges
        self.grains = census.grains
        self.counts = census.counts[:, index]
        self.masses = census.masses[:, index]
        self.temperatures = census.temperatures[:, index]
        self.largest = census.largest[:, index]
        self.diameters = census.diameters[:, index]
        self.coefficients = census.coefficients
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

    def shares(self, edges: Floats, weight: str) -> Floats:
        """Return the shares of classes with edges in m, (q + 1,), shape (1 + n, q)."""
        classes = left_out_sums(self.amounts(weight) @ class_fractions(self.edges, edges))
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
