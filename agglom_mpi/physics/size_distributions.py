"""Distributions of the grains' sizes at the start: drawing, moments, quantiles, classes.

All of them are for radii b over their mean ⟨b⟩ = b⁰, so that the mean is 1. They are by number;
shares by volume weigh each grain by b³. They are immutable, and what is derived from one is
calculated once.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

MAX_CLASSES: Final = 64
"""Maximum number of radii that stand for a law where pairs of sizes are summed over."""
_MIDDLES: Final = (np.arange(MAX_CLASSES) + 0.5) / MAX_CLASSES


class SizeDistribution:
    """Base class of the distributions, each of which defines `draw`, `moment` and `quantile`."""

    def draw(self, random: np.random.Generator, count: int) -> Floats:
        """Return b/b⁰ of `count` grains, shape (count,)."""
        raise NotImplementedError

    def moment(self, power: int) -> float:
        """Return ⟨bᵏ⟩/⟨b⟩ᵏ for a power k from 0."""
        raise NotImplementedError

    def quantile(self, share: float, by_volume: bool = False) -> float:
        """Return b/b⁰ below which a share from 0 to 1 of the grains, or of their volume, lies."""
        raise NotImplementedError

    @cached_property
    def is_equal(self) -> bool:
        """Whether all grains are equal, so that nothing is drawn."""
        return False

    @cached_property
    def third_moment(self) -> float:
        """⟨b³⟩/⟨b⟩³: the mean volume over that of the mean radius."""
        return self.moment(3)

    @cached_property
    def volume_mean(self) -> float:
        """⟨b⁴⟩/⟨b³⟩ over the mean: the mean radius by volume, D[4,3] over the mean diameter."""
        return self.moment(4) / self.third_moment

    def volume_deviation(self, count: int) -> float:
        """Return the relative standard deviation of the volume of `count` drawn grains.

        √((⟨b⁶⟩/⟨b³⟩² − 1)/count), as their volumes are independent.
        """
        spread = self.moment(6) / self.third_moment**2 - 1.0
        return math.sqrt(max(spread, 0.0) / count)

    @cached_property
    def classes(self) -> tuple[Floats, Floats]:
        """Radii b/b⁰ that stand for the law, and the share of the grains of each, (n,) each."""
        radii = np.array([self.quantile(share) for share in _MIDDLES.tolist()])
        return radii, np.full(MAX_CLASSES, 1.0 / MAX_CLASSES)


@dataclass(frozen=True)
class LognormalDistribution(SizeDistribution):
    """ln b is normal with the standard deviation `log_spread`, by number and by volume.

    The medians by volume and by number differ by the factor exp(3 log_spread²) (Hatch and Choate).
    """

    log_spread: float

    def draw(self, random: np.random.Generator, count: int) -> Floats:
        """Return b/b⁰ of `count` grains, shape (count,)."""
        spread = self.log_spread
        return np.exp(spread * random.standard_normal(count) - 0.5 * spread**2)

    def moment(self, power: int) -> float:
        """Return ⟨bᵏ⟩/⟨b⟩ᵏ = exp((k² − k)/2 · log_spread²)."""
        return math.exp(0.5 * (power * power - power) * self.log_spread**2)

    def quantile(self, share: float, by_volume: bool = False) -> float:
        """Return b/b⁰ below which a share of the grains, or of their volume, lies."""
        centre = (3.0 if by_volume else 0.0) - 0.5
        logarithm = self.log_spread * NormalDist().inv_cdf(share) + centre * self.log_spread**2
        return math.exp(logarithm)

    @cached_property
    def classes(self) -> tuple[Floats, Floats]:
        """Radii b/b⁰ that stand for the law, and the share of the grains of each, (n,) each."""
        points = np.array([NormalDist().inv_cdf(share) for share in _MIDDLES.tolist()])
        radii = np.exp(self.log_spread * points - 0.5 * self.log_spread**2)
        return radii, np.full(MAX_CLASSES, 1.0 / MAX_CLASSES)


@dataclass(frozen=True)
class UniformDistribution(SizeDistribution):
    """b is uniform by number from `smallest` to `largest`, whose mean is 1."""

    smallest: float
    largest: float

    def draw(self, random: np.random.Generator, count: int) -> Floats:
        """Return b/b⁰ of `count` grains, shape (count,)."""
        return random.uniform(self.smallest, self.largest, count)

    def moment(self, power: int) -> float:
        """Return ⟨bᵏ⟩/⟨b⟩ᵏ: the sum over even j of C(k, j) δʲ/(j + 1), δ half of the width."""
        half = 0.5 * (self.largest - self.smallest)
        return sum(math.comb(power, j) / (j + 1) * half**j for j in range(0, power + 1, 2))

    def quantile(self, share: float, by_volume: bool = False) -> float:
        """Return b/b⁰ below which a share of the grains, or of their volume, lies."""
        power = 4 if by_volume else 1
        low, high = self.smallest**power, self.largest**power
        return float((low + share * (high - low)) ** (1.0 / power))


@dataclass(frozen=True)
class VolumeUniformDistribution(SizeDistribution):
    """b is uniform by volume from `smallest` to `largest`, so that ∝ b⁻³ by number.

    The mean by number is the harmonic mean of both ends, here 1.
    """

    smallest: float
    largest: float

    def draw(self, random: np.random.Generator, count: int) -> Floats:
        """Return b/b⁰ of `count` grains, shape (count,), by the inverse of their distribution."""
        low, high = self.smallest**-2, self.largest**-2
        return np.asarray((low - random.random(count) * (low - high)) ** -0.5)

    def moment(self, power: int) -> float:
        """Return ⟨bᵏ⟩/⟨b⟩ᵏ = ∫bᵏ⁻³ db/∫b⁻³ db."""
        return self._integral(power - 3) / self._integral(-3)

    def _integral(self, power: int) -> float:
        """Return the integral of bᵖ from the smallest to the largest b."""
        if power == -1:
            return math.log(self.largest / self.smallest)
        return float(self.largest ** (power + 1) - self.smallest ** (power + 1)) / (power + 1)

    def quantile(self, share: float, by_volume: bool = False) -> float:
        """Return b/b⁰ below which a share of the grains, or of their volume, lies."""
        if by_volume:
            return self.smallest + share * (self.largest - self.smallest)
        low, high = self.smallest**-2, self.largest**-2
        return float((low - share * (low - high)) ** -0.5)


@dataclass(frozen=True, eq=False)
class ListedDistribution(SizeDistribution):
    """b is one of `ratios`, shape (n,), whose mean by number is 1.

    All are as likely by number, or by volume where `by_volume`: then a row has b⁻³ of the grains.
    """

    ratios: Floats
    by_volume: bool = False

    @cached_property
    def is_equal(self) -> bool:
        """Whether all grains are equal, so that nothing is drawn."""
        return bool(self.ratios.min() == self.ratios.max())

    @cached_property
    def _shares(self) -> Floats:
        """Share of the grains of each row, (n,)."""
        weights = self.ratios**-3 if self.by_volume else np.ones(len(self.ratios))
        return np.asarray(weights / weights.sum())

    @cached_property
    def _sums(self) -> Floats:
        """Share of the grains up to each row, (n,)."""
        return np.cumsum(self._shares)

    def draw(self, random: np.random.Generator, count: int) -> Floats:
        """Return b/b⁰ of `count` grains, shape (count,)."""
        last = len(self.ratios) - 1
        if not self.by_volume:
            return self.ratios[random.integers(last + 1, size=count)]
        rows = np.searchsorted(self._sums, random.random(count), side="right")
        return self.ratios[np.minimum(rows, last)]

    def moment(self, power: int) -> float:
        """Return ⟨bᵏ⟩/⟨b⟩ᵏ."""
        powers = self.ratios**power
        return float(self._shares @ powers if self.by_volume else np.mean(powers))

    @cached_property
    def _cumulative(self) -> tuple[Floats, tuple[Floats, Floats]]:
        """Radii in order, (n,), and the cumulative shares by number and by volume, (n,) each."""
        order = np.argsort(self.ratios)
        radii, shares = self.ratios[order], self._shares[order]
        sums = [np.cumsum(weights) / np.sum(weights) for weights in (shares, shares * radii**3)]
        return radii, (sums[0], sums[1])

    def quantile(self, share: float, by_volume: bool = False) -> float:
        """Return the smallest b/b⁰ up to which a share of the grains, or of their volume, lies."""
        radii, sums = self._cumulative
        row = np.searchsorted(sums[by_volume], share * (1.0 - 1e-12))
        return float(radii[min(int(row), len(radii) - 1)])

    @cached_property
    def classes(self) -> tuple[Floats, Floats]:
        """Radii b/b⁰ that stand for the law, and the share of the grains of each, (n,) each.

        Up to `MAX_CLASSES` different radii are exact.
        """
        radii, rows, counts = np.unique(self.ratios, return_inverse=True, return_counts=True)
        if len(radii) <= MAX_CLASSES:
            if self.by_volume:
                return radii, np.asarray(np.bincount(rows, self._shares), np.float64)
            return radii, counts / len(self.ratios)
        if self.by_volume:
            return super().classes
        return np.quantile(self.ratios, _MIDDLES), np.full(MAX_CLASSES, 1.0 / MAX_CLASSES)


SizeLaw: TypeAlias = SizeDistribution | None
"""A distribution of sizes; None: all grains are equal."""

_ONE_CLASS: Final = (np.ones(1), np.ones(1))


def draw_radii(law: SizeLaw, random: np.random.Generator, count: int) -> Floats:
    """Return b/b⁰ of `count` grains, shape (count,), the largest first; equal grains draw nothing.

    The largest are placed first, which jams less.
    """
    if law is None or law.is_equal:
        return np.ones(count)
    return np.sort(law.draw(random, count))[::-1].copy()


def third_moment(law: SizeLaw) -> float:
    """Return ⟨b³⟩/⟨b⟩³: the mean volume over that of the mean radius."""
    return 1.0 if law is None else law.third_moment


def size_classes(law: SizeLaw) -> tuple[Floats, Floats]:
    """Return radii b/b⁰ that stand for a law, and the share of the grains of each, (n,) each.

    Those of a list are exact; of other laws, the middles of `MAX_CLASSES` classes as likely.
    """
    return _ONE_CLASS if law is None else law.classes
