"""The box that is searched: bounds of the ten variables, and how strings are drawn from it."""

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
    """

    def __init__(
        self, lower: ArrayLike, upper: ArrayLike, outermost: "SearchSpace | None" = None
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
        self.outermost = self if outermost is None else outermost

    @property
    def searched(self) -> NDArray[np.bool_]:
        """Which components vary, shape (10,)."""
        return self.lower < self.upper

    def sample(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw one string uniformly from the box, shape (10,).

        Ten numbers are drawn whatever is searched, so that fixing one component leaves the
        draws of the others as they were.
        """
        return self.clip(self.lower + rng.random(COUNT) * (self.upper - self.lower))

    def clip(self, strings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Move strings, shape (..., 10), to the nearest point of the box; unused become nan."""
        return np.clip(strings, self.lower, self.upper)

    def around(self, centre: NDArray[np.float64], factor: float) -> Self:
        """Restrict the box around a string [B 8, "restricted and rescaled"].

        Every searched half-width is multiplied by `factor`; what then sticks out of the
        outermost box is cut off. A box cut on one side is no longer centred on the string, and
        the next restriction starts from what the cut has left.

        Parameters
        ----------
        centre
            The string to centre on, shape (10,); only its searched components count.
        factor
            Ratio of new to old half-width.
        """
        outer = self.outermost
        half = 0.5 * factor * (self.upper - self.lower)
        middle = outer.clip(centre)
        lower = np.where(self.searched, np.maximum(middle - half, outer.lower), self.lower)
        upper = np.where(self.searched, np.minimum(middle + half, outer.upper), self.upper)
        return type(self)(lower, upper, outer)
