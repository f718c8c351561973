"""Shares of classes of size, with the covariance of their errors.

Errors are independent either of the amounts that were measured in the classes, as where grains are
counted or weighed, or of the values of a cumulative curve. The shares of both sum to 1, so that
their covariance, shape (q, q), has the rank q - 1.
"""

import math
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from agglom_mpi.measurements.quantities import QUANTITIES

Numbers: TypeAlias = npt.NDArray[np.float64]
ShareWeight: TypeAlias = Literal["number", "area", "mass"]

POWER: Final[dict[ShareWeight, int]] = {"number": 0, "area": 2, "mass": 3}
"""Power of the diameter that is the weight of a grain."""
MIN_COUNT: Final = 5.0
"""Minimum number of counted grains of a class, from which its share is nearly normal."""
MIN_LISTED_SHARE: Final = 0.05
"""Minimum share of the classes that are made from single diameters."""


class SizeCurve(NamedTuple):
    """Measured shares of classes of size.

    Attributes
    ----------
    edges
        Edges of the classes, m, shape (q + 1,), ascending; the first may be 0 and the last inf.
    shares
        Shares of the classes, shape (q,); they sum to 1.
    errors
        Standard errors, each independent: of the amounts of the classes over the total, shape
        (q,), or of the cumulative curve at the inner edges, shape (q - 1,).
    errors_of
        Which of the two.
    weight
        Whether shares are of the number, the area or the mass of the grains.
    """

    edges: tuple[float, ...]
    shares: tuple[float, ...]
    errors: tuple[float, ...]
    errors_of: Literal["shares", "passing"]
    weight: ShareWeight

    @property
    def covariance(self) -> Numbers:
        """Covariance of the shares, shape (q, q)."""
        count = len(self.shares)
        if self.errors_of == "passing":
            change = np.zeros((count, count - 1))  # of shares by the values at the inner edges
            np.fill_diagonal(change, 1.0)
            np.fill_diagonal(change[1:], -1.0)
        else:
            change = np.eye(count) - np.array(self.shares)[:, None]
        return np.asarray((change * np.square(self.errors)) @ change.T)

    def diameters(self) -> dict[tuple[str, str], tuple[float, float]]:
        """Return the range of each diameter that follows from the closed classes, by its name.

        Names are quantity and weight. Interpolation within a class is linear or logarithmic.
        """
        edges, below = np.array(self.edges), np.cumsum([0.0, *self.shares])
        closed = (edges > 0.0) & np.isfinite(edges)
        found: dict[tuple[str, str], tuple[float, float]] = {}
        for name, kind in QUANTITIES.items():
            if kind.share is None:
                continue
            log, linear = (
                float(np.interp(kind.share, below[closed], ends, np.nan, np.nan))
                for ends in (np.log(edges[closed]), edges[closed])
            )
            found[name, self.weight] = math.exp(log), linear
        if closed[1:].all():
            middles = np.sqrt(edges[1:] * edges[:-1]), 0.5 * (edges[1:] + edges[:-1])
            low, high = (float(each @ self.shares) for each in middles)
            found["mean_diameter", self.weight] = low, high
        return found


class MeasuredClasses(NamedTuple):
    """Classes with independent amounts: edges (q + 1,) in m, shares, variances and counts (q,)."""

    edges: Numbers
    shares: Numbers
    variances: Numbers
    counts: Numbers

    def curve(self, weight: ShareWeight) -> SizeCurve:
        """Return the curve of the classes."""
        errors = np.sqrt(self.variances)
        edges, shares, own = (tuple(each.tolist()) for each in (self.edges, self.shares, errors))
        return SizeCurve(edges, shares, own, "shares", weight)

    def joined(self, least_count: float, least_share: float) -> "MeasuredClasses":
        """Return the classes joined from the coarsest on until each has enough grains.

        The finest grains that are left over belong to the class above them.
        """
        ends, count, share = [len(self.shares)], 0.0, 0.0
        for i in range(len(self.shares) - 1, -1, -1):
            count, share = count + self.counts[i], share + self.shares[i]
            if count >= least_count and share >= least_share:
                ends.append(i)
                count = share = 0.0
        if len(ends) > 1:
            ends[-1] = 0
        else:
            ends.append(0)
        kept = ends[::-1]
        sums = (
            np.add.reduceat(each, kept[:-1]) for each in (self.shares, self.variances, self.counts)
        )
        return MeasuredClasses(self.edges[kept], *sums)


def curve_of_passing(
    sizes: Numbers, passing: Numbers, errors: Numbers, weight: ShareWeight
) -> SizeCurve:
    """Return the curve of shares that are smaller than some sizes.

    Parameters
    ----------
    sizes
        Sizes in m, shape (n,), ascending.
    passing
        Shares of what is smaller, shape (n,), which do not decrease.
    errors
        Their standard errors, shape (n,).
    weight
        What the shares are of.
    """
    first = max(int(np.count_nonzero(passing <= 0.0)) - 1, 0)
    last = len(sizes) - max(int(np.count_nonzero(passing >= 1.0)) - 1, 0)
    sizes, passing, errors = sizes[first:last], passing[first:last], errors[first:last]
    inner = (passing > 0.0) & (passing < 1.0)
    edges, values = sizes.tolist(), passing.tolist()
    if values[0] > 0.0:
        edges, values = [0.0, *edges], [0.0, *values]
    if values[-1] < 1.0:
        edges, values = [*edges, np.inf], [*values, 1.0]
    shares = tuple(np.diff(values).tolist())
    return SizeCurve(tuple(edges), shares, tuple(errors[inner].tolist()), "passing", weight)


def curve_of_amounts(
    edges: Numbers, amounts: Numbers, errors: Numbers, weight: ShareWeight
) -> SizeCurve:
    """Return the curve of amounts in classes, each with its standard error, both (q,).

    Empty classes at the ends are left out.
    """
    total = amounts.sum()
    filled = np.flatnonzero(amounts > 0.0)
    kept = slice(int(filled[0]), int(filled[-1]) + 1)
    found = MeasuredClasses(
        edges[kept.start : kept.stop + 1],
        amounts[kept] / total,
        (errors[kept] / total) ** 2,
        amounts[kept],
    )
    return found.curve(weight)


def curve_of_counted(
    edges: Numbers, shares: Numbers, counted: float, weight: ShareWeight
) -> SizeCurve:
    """Return the curve of classes with a number of counted grains.

    The shares (q,) may be of the area or the mass of these grains; how many grains they stand for
    follows from the geometric mean of a class's edges. A class that is open at one end counts as
    one as wide as its neighbour.
    """
    closed = edges.copy()
    if closed[0] == 0.0:
        closed[0] = closed[1] ** 2 / closed[2] if len(edges) > 3 else 0.5 * closed[1]
    if np.isinf(closed[-1]):
        closed[-1] = closed[-2] ** 2 / closed[-3]
    diameters = np.sqrt(closed[1:] * closed[:-1])
    numbers = shares / (diameters / diameters.max()) ** POWER[weight]
    counts = counted * numbers / numbers.sum()
    variances = np.divide(shares**2, counts, out=np.zeros_like(shares), where=counts > 0.0)
    return MeasuredClasses(edges, shares, variances, counts).joined(MIN_COUNT, 0.0).curve(weight)


def curve_of_diameters(diameters: Numbers, weight: ShareWeight) -> SizeCurve:
    """Return the curve of single grains, by their diameters in m, in classes of enough of them."""
    sizes, counts = np.unique(diameters, return_counts=True)
    between = np.sqrt(sizes[1:] * sizes[:-1])
    edges = np.concatenate([[0.0], between, [np.inf]])
    each = (sizes / sizes[-1]) ** POWER[weight]
    total = float(counts @ each)
    found = MeasuredClasses(
        edges, counts * each / total, counts * (each / total) ** 2, counts.astype(np.float64)
    )
    return found.joined(MIN_COUNT, MIN_LISTED_SHARE).curve(weight)
