"""The share of the search box that satisfies the constraints, by random strings."""

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from agglom_mpi.formatting import format_digits
from agglom_mpi.random_streams import ALLOWED_SHARE, search_stream
from agglom_mpi.search.space import SearchSpace

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

LEAST_SHARE: Final = 1e-4
"""Share below which a campaign is refused: to propose a string takes too long."""
SMALL_SHARE: Final = 1e-2
"""Share below which there is a warning."""

STRINGS: Final = 1 << 14
"""Random strings of a first estimate."""
MORE_STRINGS: Final = 1 << 18
"""Random strings if the first estimate rests on less than `FEW` allowed ones."""
FEW: Final = 400


class AllowedShare(NamedTuple):
    """The share of n random strings of the box that satisfy all constraints.

    Strings are uniform in the coordinates in which the box is searched.
    """

    allowed: int
    strings: int

    @property
    def value(self) -> float:
        """The share."""
        return self.allowed / self.strings

    @property
    def error(self) -> float:
        """Its standard error."""
        return math.sqrt(self.value * (1.0 - self.value) / self.strings)

    def __str__(self) -> str:
        if not self.allowed:
            return f"no string of {self.strings:,}"
        percent = format_digits(100.0 * self.value, 3)
        return f"{percent} % (± {format_digits(100.0 * self.error, 1)} %)"


@lru_cache(1)  # a command asks several times for the campaign that it is about
def allowed_share(campaign: "Campaign") -> AllowedShare:
    """Return the share of the box that a campaign's constraints allow."""
    space = SearchSpace.of(campaign.variables)
    if not space.dimensions:
        return AllowedShare(
            int(campaign.allowed_strings(campaign.variables.at(0.5)[None]).sum()), 1
        )
    random = search_stream(campaign.seed, ALLOWED_SHARE)

    def count(strings: int) -> int:
        points = random.random((strings, space.dimensions))
        return int(np.count_nonzero(campaign.allowed_strings(space.from_unit(points))))

    share = AllowedShare(count(STRINGS), STRINGS)
    if share.allowed >= FEW:
        return share
    return AllowedShare(share.allowed + count(MORE_STRINGS - STRINGS), MORE_STRINGS)
