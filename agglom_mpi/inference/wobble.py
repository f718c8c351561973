"""Deviations of the variables of strings, which a probability is averaged over."""

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.inference.searched_box import SearchedBox

DEVIATIONS: Final = 16
"""Number of deviations of a string that its probability is averaged over."""


def even_places(count: int) -> Floats:
    """Return deviations of `count` variables, (`DEVIATIONS`, count), evenly from -1 to 1."""
    from scipy.stats import qmc

    points = qmc.Sobol(count, scramble=False).random(DEVIATIONS)
    return np.asarray(2.0 * points + 1.0 / DEVIATIONS - 1.0)  # in the middle of their intervals


class Wobble:
    """Values of the variables of strings that deviate evenly by up to a share of themselves.

    The emulator is known in the box alone, so a deviation that would leave the box ends at its
    edge, both in probabilities and in strings that are judged. Near an edge, that edge therefore
    counts more often than any one value inside. Deviations may break the constraints; they are then
    no members.

    Parameters
    ----------
    box
    robust
        By name, the largest relative deviation of a variable; none where nothing deviates.
    """

    def __init__(self, box: SearchedBox, robust: Mapping[str, float]) -> None:
        self._space = box.space
        named = {variable.name: variable for variable in box.own}
        self._wobbling = [(named[name], share) for name, share in robust.items()]

    def __bool__(self) -> bool:
        return bool(self._wobbling)

    def wobbled(self, strings: Floats, places: Floats) -> Floats:
        """Return strings, (n, k), with values at places from -1 to 1, (n, w) or (w,).

        A value that would leave the box is at its edge.
        """
        found = strings.copy()
        for i, (variable, share) in enumerate(self._wobbling):
            factors = 1.0 + share * np.asarray(places)[..., i]
            found[:, variable.column] *= factors ** (1.0 / variable.power)
        return np.asarray(self._space.clip(found))

    def drawn(self, strings: Floats, random: np.random.Generator) -> Floats:
        """Return strings, (n, k), each with drawn values."""
        shape = len(strings), len(self._wobbling)
        return self.wobbled(strings, random.uniform(-1.0, 1.0, shape)) if shape[1] else strings

    def mean(self, function: Callable[[Floats], Any], strings: Floats) -> Any:
        """Return the mean of a function of strings, (n, k), over their deviations."""
        if not self._wobbling:
            return function(strings)
        places = even_places(len(self._wobbling))
        return np.mean([function(self.wobbled(strings, place)) for place in places], axis=0)
