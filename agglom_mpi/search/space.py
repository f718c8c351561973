"""The search box: bounds of the ten variables, scaling, sampling and clipping of strings."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agglom_mpi.variables import COUNT


class SearchSpace:
    """A box of parameter strings [A 28] [B 7.3].

    Parameters
    ----------
    lower, upper
        Bounds in the order and SI units of `agglom_mpi.variables.VARIABLES`, shape (10,). A
        fixed component has equal bounds, an unused one has nan for both.
    outermost
        The box that no restriction may leave; this box itself by default.
    logarithmic
        Components searched by their logarithms, shape (10,); none by default. Their bounds are
        positive.
    """

    def __init__(
        self,
        lower: ArrayLike,
        upper: ArrayLike,
        outermost: "SearchSpace | None" = None,
        logarithmic: ArrayLike | None = None,
    ) -> None:
        self.lower = np.array(lower, dtype=np.float64)
        self.upper = np.array(upper, dtype=np.float64)
        if self.lower.shape != (COUNT,) or self.upper.shape != (COUNT,):
            raise ValueError(f"a search space has {COUNT} lower and {COUNT} upper bounds")
        unused = np.isnan(self.lower) & np.isnan(self.upper)
        bounded = np.isfinite(self.lower) & np.isfinite(self.upper) & (self.lower <= self.upper)
        if not np.all(unused | bounded):
            raise ValueError("bounds must be finite and in order, or both nan")
        self.lower.setflags(write=False)
        self.upper.setflags(write=False)
        scaled = np.zeros(COUNT) if logarithmic is None else logarithmic
        self.logarithmic = self.searched & np.array(scaled, dtype=np.bool_)
        if np.any(self.lower[self.logarithmic] <= 0.0):
            raise ValueError("what is searched by its logarithm must be positive")
        self.outermost = self if outermost is None else outermost

    @property
    def searched(self) -> NDArray[np.bool_]:
        """Mask of the components that vary, shape (10,)."""
        return self.lower < self.upper

    @property
    def dimensions(self) -> int:
        """Number of components that vary, d."""
        return int(self.searched.sum())

    def scaled(self, strings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return strings, shape (..., 10), with logarithms of the logarithmic components."""
        if not self.logarithmic.any():
            return strings
        scaled = np.array(strings)
        scaled[..., self.logarithmic] = np.log(scaled[..., self.logarithmic])
        return scaled

    def unscaled(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the strings, shape (..., 10), of scaled ones."""
        if not self.logarithmic.any():
            return scaled
        strings = np.array(scaled)
        strings[..., self.logarithmic] = np.exp(strings[..., self.logarithmic])
        return strings

    def to_unit(self, strings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return strings, shape (n, 10), as points of the unit cube, shape (n, d)."""
        lower, upper = self.scaled(self.lower), self.scaled(self.upper)
        some = self.searched
        return (self.scaled(strings) - lower)[:, some] / (upper - lower)[some]

    def from_unit(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the strings, shape (n, 10), of points of the unit cube, shape (n, d)."""
        lower, upper = self.scaled(self.lower), self.scaled(self.upper)
        scaled = np.tile(lower, (len(points), 1))
        some = self.searched
        scaled[:, some] = lower[some] + points * (upper - lower)[some]
        return self.clip(self.unscaled(scaled))

    def sample(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw one string uniformly from the box, shape (10,).

        Ten numbers are drawn whatever is searched, so that fixing one component leaves the
        draws of the others as they were.
        """
        lower, upper = self.scaled(self.lower), self.scaled(self.upper)
        return self.clip(self.unscaled(lower + rng.random(COUNT) * (upper - lower)))

    def clip(self, strings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the nearest strings in the box, shape (..., 10); unused components become nan."""
        return np.clip(strings, self.lower, self.upper)

    def around(self, centre: NDArray[np.float64], factor: float) -> Self:
        """Return the box restricted around a string [B 8, "restricted and rescaled"].

        Every searched half-width is multiplied by `factor`; what is then outside of the
        outermost box is cut off. A box cut on one side is no longer centred on the string, and
        the next restriction starts from what the cut has left.

        Parameters
        ----------
        centre
            The string, shape (10,); only its searched components count.
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
        return type(self)(lower, upper, outer, self.logarithmic)
