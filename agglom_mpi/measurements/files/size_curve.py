"""Shares of classes of size, with the covariance of their errors.

Errors are independent either of the amounts that were measured in the classes, as where grains are
counted or weighed, or of the values of a cumulative curve. The shares of both sum to 1, so that
their covariance, shape (q, q), has the rank q - 1.
"""

import math
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np

from agglom_mpi.measurements.quantities import QUANTITIES
from agglom_mpi.statistics import Floats

Numbers: TypeAlias = Floats
ShareWeight: TypeAlias = Literal["number", "area", "mass"]

POWER: Final[dict[ShareWeight, int]] = {"number": 0, "area": 2, "mass": 3}
"""Power of the diameter that is the weight of a grain."""
MIN_COUNT: Final = 5.0
"""Minimum number of counted grains of a class, from which its share is nearly normal."""
MIN_LISTED_SHARE: Final = 0.05
"""Minimum share of the classes that are made from single diameters."""
GRAINS: Final = 1000
"""Number of diameters that stand for a curve."""


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

    def grains(self) -> Numbers:
        """Return diameters in m of the same amount each, shape (`GRAINS`,), of closed classes.

        Within a class the amount is uniform in the logarithm of the diameter.
        """
        below = np.cumsum([0.0, *self.shares])
        amounts = (np.arange(GRAINS) + 0.5) / GRAINS * below[-1]
        return np.asarray(np.exp(np.interp(amounts, below, np.log(self.edges))))

    def mean_error(self, power: int) -> float:
        """Return the relative standard error of the mean diameter D[power + 1, power].

        The power is 0 by number and 3 by volume (ISO 9276-2). Classes are closed and filled as by
        `grains`; the error is to first order.
        """
        edges, shares = np.array(self.edges), np.array(self.shares)

        def moments(k: int) -> Numbers:
            """Return ⟨dᵏ⟩ of each class by amount, with d over the largest, shape (q,)."""
            ends = (edges / edges[-1]) ** k
            return np.diff(ends) / (k * np.diff(np.log(edges))) if k else np.ones(len(shares))

        above, below = (moments(power + k - POWER[self.weight]) for k in (1, 0))
        slope = above / (above @ shares) - below / (below @ shares)
        return math.sqrt(slope @ self.covariance @ slope)

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


def curve_of_classes(
    edges: Numbers,
    shares: Numbers,
    variances: Numbers,
    weight: ShareWeight,
    counts: Numbers | None = None,
    least_share: float = 0.0,
) -> SizeCurve:
    """Return the curve of classes with independent amounts.

    Parameters
    ----------
    edges
        Edges of the classes in m, shape (q + 1,).
    shares, variances
        Shares of the classes and the variances of their amounts over the total, shape (q,) each.
    weight
        What the shares are of.
    counts
        Numbers of grains of the classes, shape (q,). Classes are joined from the coarsest on until
        each has enough of them; the finest grains that are left over belong to the class above.
    least_share
        Minimum share of a joined class.
    """
    if counts is not None:
        ends, count, share = [len(shares)], 0.0, 0.0
        for i in range(len(shares) - 1, -1, -1):
            count, share = count + counts[i], share + shares[i]
            if count >= MIN_COUNT and share >= least_share:
                ends.append(i)
                count = share = 0.0
        kept = [0, *ends[: max(len(ends) - 1, 1)][::-1]]
        shares, variances = (np.add.reduceat(each, kept[:-1]) for each in (shares, variances))
        edges = edges[kept]
    own = tuple(np.sqrt(variances).tolist())
    return SizeCurve(tuple(edges.tolist()), tuple(shares.tolist()), own, "shares", weight)


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
    first, last = int(filled[0]), int(filled[-1]) + 1
    variances = (errors[first:last] / total) ** 2
    return curve_of_classes(edges[first : last + 1], amounts[first:last] / total, variances, weight)


def curve_of_counted(curve: SizeCurve, counted: float) -> SizeCurve:
    """Return a curve with the errors of a number of counted grains.

    Its shares may be of the area or the mass of these grains; how many grains they stand for
    follows from the geometric mean of a class's edges. A class that is open at one end counts as
    one as wide as its neighbour.
    """
    edges, shares = np.array(curve.edges), np.array(curve.shares)
    closed = edges.copy()
    if closed[0] == 0.0:
        closed[0] = closed[1] ** 2 / closed[2] if len(edges) > 3 else 0.5 * closed[1]
    if np.isinf(closed[-1]):
        closed[-1] = closed[-2] ** 2 / closed[-3]
    diameters = np.sqrt(closed[1:] * closed[:-1])
    numbers = shares / (diameters / diameters.max()) ** POWER[curve.weight]
    counts = counted * numbers / numbers.sum()
    variances = np.divide(shares**2, counts, out=np.zeros_like(shares), where=counts > 0.0)
    return curve_of_classes(edges, shares, variances, curve.weight, counts)


def curve_of_diameters(diameters: Numbers, weight: ShareWeight) -> SizeCurve:
    """Return the curve of single grains, by their diameters in m, in classes of enough of them."""
    sizes, numbers = np.unique(diameters, return_counts=True)
    between = np.sqrt(sizes[1:] * sizes[:-1])
    edges = np.concatenate([[0.0], between, [np.inf]])
    each = (sizes / sizes[-1]) ** POWER[weight]
    total = float(numbers @ each)
    shares, variances = numbers * each / total, numbers * (each / total) ** 2
    counts = numbers.astype(np.float64)
    return curve_of_classes(edges, shares, variances, weight, counts, MIN_LISTED_SHARE)
