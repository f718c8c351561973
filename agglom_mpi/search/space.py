"""The search box: bounds of the variables, scaling, sampling and clipping of strings."""

import copy
from collections.abc import Callable
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agglom_mpi.statistics import Floats
from agglom_mpi.variables import VariableTable

Allowed = Callable[[Floats], NDArray[np.bool_]]
"""Function of strings, (n, k), that returns which of them may be proposed, (n,)."""

MOST_DRAWS: Final = 1 << 20
"""Strings drawn at most to find one that may be proposed."""
BLOCK: Final = 4096
"""Strings drawn at most at a time."""
STEPS: Final = 10
"""Steps of a random walk through what is allowed."""
MOST_SHRINKS: Final = 60
"""Maximum number of points that are tried in a step; a part of a line is halved by each."""
HALVINGS: Final = 20
"""Steps by which the end of what is allowed on a line is found: to a millionth of its length."""


class SearchSpace:
    """A box of parameter strings [A 28] [B 7.3].

    Parameters
    ----------
    lower, upper
        Bounds in the order and SI units of the campaign's variables, shape (k,). A fixed
        component has equal bounds, an unused one has nan for both.
    outermost
        The box that no restriction may leave; this box itself by default.
    logarithmic
        Components searched by their logarithms, shape (k,); none by default. Their bounds are
        positive.
    cubic
        Components searched by their cubes, shape (k,); none by default.

    Attributes
    ----------
    allowed
        Which strings of the box may be proposed; None: all. See `within`.
    centre
        An allowed string of the box that it was restricted around, shape (k,); None if it was not.
    """

    def __init__(
        self,
        lower: ArrayLike,
        upper: ArrayLike,
        outermost: "SearchSpace | None" = None,
        logarithmic: ArrayLike | None = None,
        cubic: ArrayLike | None = None,
    ) -> None:
        self.lower = np.array(lower, dtype=np.float64)
        self.upper = np.array(upper, dtype=np.float64)
        if self.lower.ndim != 1 or self.upper.shape != self.lower.shape:
            raise ValueError("the bounds of a search space are two vectors of one length")
        unused = np.isnan(self.lower) & np.isnan(self.upper)
        bounded = np.isfinite(self.lower) & np.isfinite(self.upper) & (self.lower <= self.upper)
        if not np.all(unused | bounded):
            raise ValueError("bounds must be finite and in order, or both nan")
        self.lower.setflags(write=False)
        self.upper.setflags(write=False)
        self.logarithmic, self.cubic = (
            self.searched & np.array(np.zeros(self.count) if some is None else some, dtype=np.bool_)
            for some in (logarithmic, cubic)
        )
        if np.any(self.lower[self.logarithmic] <= 0.0):
            raise ValueError("what is searched by its logarithm must be positive")
        self.outermost = self if outermost is None else outermost
        self.allowed: Allowed | None = None
        self.centre: Floats | None = None

    @classmethod
    def of(cls, variables: VariableTable) -> Self:
        """Return the box of a campaign's variables."""
        return cls(
            variables.lower,
            variables.upper,
            logarithmic=variables.logarithmic,
            cubic=variables.cubic,
        )

    def within(self, allowed: Allowed | None) -> Self:
        """Return the box with only some of its strings allowed."""
        box = copy.copy(self)
        box.allowed = allowed
        if self.outermost is self:
            box.outermost = box
        return box

    def allows(self, points: Floats) -> NDArray[np.bool_]:
        """Return which points of the unit cube, shape (n, d), are allowed strings, shape (n,)."""
        if self.allowed is None:
            return np.ones(len(points), np.bool_)
        return self.allowed(self.from_unit(points))

    @property
    def searched(self) -> NDArray[np.bool_]:
        """Mask of the components that vary, shape (k,)."""
        return self.lower < self.upper

    @property
    def count(self) -> int:
        """Number of components of a string, k."""
        return len(self.lower)

    @property
    def no_strings(self) -> Floats:
        """An array of no strings, shape (0, k)."""
        return np.empty((0, self.count))

    @property
    def dimensions(self) -> int:
        """Number of components that vary, d."""
        return int(self.searched.sum())

    def scaled(self, strings: Floats) -> Floats:
        """Return strings, shape (..., k), in the coordinates in which the box is searched.

        These are logarithms of the logarithmic components and cubes of the cubic ones.
        """
        if not (self.logarithmic.any() or self.cubic.any()):
            return strings
        scaled = np.array(strings)
        scaled[..., self.logarithmic] = np.log(scaled[..., self.logarithmic])
        scaled[..., self.cubic] = scaled[..., self.cubic] ** 3
        return scaled

    def unscaled(self, scaled: Floats) -> Floats:
        """Return the strings, shape (..., k), of scaled ones."""
        if not (self.logarithmic.any() or self.cubic.any()):
            return scaled
        strings = np.array(scaled)
        strings[..., self.logarithmic] = np.exp(strings[..., self.logarithmic])
        strings[..., self.cubic] = np.cbrt(strings[..., self.cubic])
        return strings

    def to_unit(self, strings: Floats) -> Floats:
        """Return strings, shape (n, k), as points of the unit cube, shape (n, d)."""
        lower, upper = self.scaled(self.lower), self.scaled(self.upper)
        some = self.searched
        return (self.scaled(strings) - lower)[:, some] / (upper - lower)[some]

    def from_unit(self, points: Floats) -> Floats:
        """Return the strings, shape (n, k), of points of the unit cube, shape (n, d)."""
        lower, upper = self.scaled(self.lower), self.scaled(self.upper)
        scaled = np.tile(lower, (len(points), 1))
        some = self.searched
        scaled[:, some] = lower[some] + points * (upper - lower)[some]
        return self.clip(self.unscaled(scaled))

    def sample(self, rng: np.random.Generator) -> Floats:
        """Draw one string uniformly from what is allowed of the box, shape (k,).

        k numbers are drawn whatever is searched, so that fixing one component leaves the
        draws of the others as they were; they are drawn again until the string is allowed.

        Raises
        ------
        RuntimeError
            If no string of `MOST_DRAWS` is, and the box has no centre.
        """
        if self.allowed is None:
            return self._drawn(rng.random(self.count))
        count, drawn = 1, 0
        while drawn < MOST_DRAWS:
            strings = self._drawn(rng.random((count, self.count)))
            allowed = np.flatnonzero(self.allowed(strings))
            if len(allowed):
                return np.asarray(strings[allowed[0]])
            drawn += count
            count = min(2 * count, BLOCK)
        if self.centre is None:
            raise RuntimeError(f"no string of {MOST_DRAWS:,} satisfies the constraints")
        points = self.towards(self.to_unit(strings[:1]), self.to_unit(self.centre[None]))
        return self.from_unit(points)[0] if self.allows(points)[0] else self.centre

    def _drawn(self, shares: Floats) -> Floats:
        """Return strings by their shares of the way from lower to upper ends, shape (..., k)."""
        lower, upper = self.scaled(self.lower), self.scaled(self.upper)
        return self.clip(self.unscaled(lower + shares * (upper - lower)))

    def sample_points(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw points uniformly from what is allowed of the unit cube, shape (count, d).

        Where fewer of `MOST_DRAWS` independent points are allowed, the others are found by random
        walks that begin at these.

        Raises
        ------
        RuntimeError
            If none of `MOST_DRAWS` is allowed.
        """
        found = np.empty((0, self.dimensions))
        if self.allowed is None:
            return rng.random((count, self.dimensions))
        for _ in range(MOST_DRAWS // BLOCK):
            points = rng.random((BLOCK, self.dimensions))
            found = np.vstack((found, points[self.allows(points)]))
            if len(found) >= count:
                return found[:count]
        if not len(found):
            raise RuntimeError(f"no string of {MOST_DRAWS:,} satisfies the constraints")
        return np.vstack((found, self._walked(found, rng, count - len(found))))

    def _walked(self, found: Floats, rng: np.random.Generator, count: int) -> Floats:
        """Return more allowed points, (count, d), by random walks from independent ones, (n, d).

        A step goes along a random line ("hit and run", Smith 1984) to a point that is drawn from
        shorter and shorter parts of it until one is allowed (shrinkage, Neal 2003). Points that
        are uniform in what is allowed stay so, whatever its shape.
        """
        points = found[rng.integers(len(found), size=count)]
        for _ in range(STEPS):
            along = rng.normal(size=points.shape)
            ends = np.stack((-points / along, (1.0 - points) / along))
            low, high = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
            left = np.arange(count)
            moved = points.copy()
            for _ in range(MOST_SHRINKS):
                at = low + rng.random(len(left)) * (high - low)
                tried = np.clip(points[left] + at[:, None] * along[left], 0.0, 1.0)
                allowed = self.allows(tried)
                moved[left[allowed]] = tried[allowed]
                low, high = np.where(at < 0.0, at, low), np.where(at < 0.0, high, at)
                left, low, high = left[~allowed], low[~allowed], high[~allowed]
                if not len(left):
                    break
            points = moved
        return points

    def towards(self, points: Floats, origins: Floats) -> Floats:
        """Return points of the unit cube, moved to their origins until they are allowed.

        Parameters
        ----------
        points
            Shape (n, d); those that are allowed stay.
        origins
            Allowed points, shape (n, d).
        """
        out = ~self.allows(points)
        if not out.any():
            return points
        begin, way = origins[out], points[out] - origins[out]
        inside, beyond = np.zeros((len(begin), 1)), np.ones((len(begin), 1))
        for _ in range(HALVINGS):
            middle = 0.5 * (inside + beyond)
            allowed = self.allows(begin + middle * way)[:, None]
            inside = np.where(allowed, middle, inside)
            beyond = np.where(allowed, beyond, middle)
        moved = points.copy()
        moved[out] = begin + inside * way
        return moved

    def clip(self, strings: Floats) -> Floats:
        """Return the nearest strings in the box, shape (..., k); unused components become nan."""
        return np.clip(strings, self.lower, self.upper)

    def around(self, centre: Floats, factor: float) -> Self:
        """Return the box restricted around a string [B 8, "restricted and rescaled"].

        Every searched half-width is multiplied by `factor`; what is then outside of the
        outermost box is cut off. A box cut on one side is no longer centred on the string, and
        the next restriction starts from what the cut has left.

        Parameters
        ----------
        centre
            The string, shape (k,); only its searched components count.
        factor
            Ratio of new to old half-width.
        """
        outer = self.outermost
        half = 0.5 * factor * (self.scaled(self.upper) - self.scaled(self.lower))
        middle = self.scaled(outer.clip(centre))
        lower = np.maximum(self.unscaled(middle - half), outer.lower)
        upper = np.minimum(self.unscaled(middle + half), outer.upper)
        lower = np.where(self.searched, lower, self.lower)
        upper = np.where(self.searched, upper, self.upper)
        box = type(self)(lower, upper, outer, self.logarithmic, self.cubic)
        box.allowed, box.centre = self.allowed, centre
        return box
