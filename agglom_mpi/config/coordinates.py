"""Coordinates in which a campaign's strings are emulated: logarithms, and dimensionless groups."""

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.groups import Group, groups_of
from agglom_mpi.variables import NAMES

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

Floats = NDArray[np.float64]

SMALL: Final = 0.05
"""What is added to a variable whose range begins at 0, in units of its upper end, before its
logarithm is taken in a group."""


class Coordinates:
    """Maps strings to the coordinates in which they are emulated, each from 0 to 1 over the box.

    There is one for each searched variable, its logarithm unless its range begins at 0, and one for
    each dimensionless group, its logarithm.

    Parameters
    ----------
    lower, upper
        The box in SI units, shape (10,).
    groups
        The groups.

    Attributes
    ----------
    searched
        Places of the d searched variables among the ten, shape (d,).
    names
        Names of the searched variables.
    groups
    """

    def __init__(self, lower: Floats, upper: Floats, groups: list[Group]) -> None:
        self.searched = np.flatnonzero(lower < upper)
        self.names = tuple(NAMES[i] for i in self.searched)
        self.groups = groups
        self._lower, self._upper = lower, upper
        self._logarithmic = lower[self.searched] > 0.0
        self._first, self._last = (self._scaled(ends[None])[0] for ends in (lower, upper))
        self._powers = np.zeros((len(groups), len(NAMES)))
        for row, group in zip(self._powers, groups, strict=True):
            row[[NAMES.index(name) for name in group.powers]] = list(group.powers.values())
        self._powers[:, ~(lower < upper)] = 0.0
        ends = np.array([self._logarithms(lower[None])[0], self._logarithms(upper[None])[0]])
        corners = self._powers[:, None, :] * ends
        self._least, self._most = corners.min(axis=1).sum(axis=1), corners.max(axis=1).sum(axis=1)

    @property
    def dimensions(self) -> int:
        """Number of coordinates, p."""
        return len(self.searched) + len(self.groups)

    @property
    def spans(self) -> Floats:
        """Range of the logarithm of each searched variable over the box, (d,).

        A range from 0 counts as if it began at `SMALL` of its upper end.
        """
        lower, upper = self._lower[self.searched], self._upper[self.searched]
        return np.asarray(np.log(upper / np.where(self._logarithmic, lower, SMALL * upper)))

    @property
    def group_directions(self) -> Floats:
        """Change of the logarithm of each group along each variable's coordinate, (g, d)."""
        return np.asarray(self._powers[:, self.searched] * self.spans)

    def of_strings(self, strings: Floats) -> Floats:
        """Return the coordinates of strings, (n, 10) in SI units, shape (n, p)."""
        own = self.own(strings)
        if not self.groups:
            return own
        values = self._logarithms(strings) @ self._powers.T
        return np.column_stack((own, (values - self._least) / (self._most - self._least)))

    def own(self, strings: Floats) -> Floats:
        """Return the coordinates of the searched variables alone, of strings (n, 10): (n, d)."""
        return np.asarray((self._scaled(strings) - self._first) / (self._last - self._first))

    def strings(self, own: Floats) -> Floats:
        """Return the strings, (n, 10), of coordinates of the searched variables, (n, d)."""
        scaled = self._first + own * (self._last - self._first)
        strings = np.tile(self._lower, (len(own), 1))
        exponents = np.where(self._logarithmic, scaled, 0.0)
        strings[:, self.searched] = np.where(self._logarithmic, np.exp(exponents), scaled)
        return strings

    def group_values(self, strings: Floats, group: Group) -> Floats:
        """Return a group of strings, (n, 10), in SI units but for constants, shape (n,)."""
        factors = [strings[:, NAMES.index(name)] ** power for name, power in group.powers.items()]
        return np.asarray(np.prod(factors, axis=0))

    def _scaled(self, strings: Floats) -> Floats:
        chosen = strings[:, self.searched]
        positive = np.where(self._logarithmic, chosen, 1.0)
        return np.where(self._logarithmic, np.log(positive), chosen)

    def _logarithms(self, strings: Floats) -> Floats:
        """Return logarithms of all ten variables, 0 for those that are not searched, (n, 10)."""
        found = np.zeros(strings.shape)
        x, top = strings[:, self.searched], self._upper[self.searched]
        found[:, self.searched] = np.log(np.where(self._logarithmic, x, x + SMALL * top))
        return found


def coordinates_of(campaign: "Campaign") -> Coordinates:
    """Return the coordinates in which a campaign's strings are emulated."""
    box = campaign.variables
    return Coordinates(box.lower, box.upper, groups_of(campaign.scene, box.searched))
