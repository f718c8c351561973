"""Numbers of strings whose samples are of larger control volumes.

A sample of a string in `volume` times the campaign's box has the string number
`volume * STRING_STRIDE + string` while it is in flight, and in `/failures`. So schedulers, messages
and ranks treat it as a sample of one more string. Volume 1, the campaign's own box, adds nothing.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

STRING_STRIDE: Final = 10**12
"""Distance of the numbers of one string in successive volumes; above any number of strings."""


class VolumeString(NamedTuple):
    """A string in a control volume: factor of the number of grains, and number of the string."""

    volume: int
    string: int

    @property
    def text(self) -> str:
        """The string for readers: `7`, or `7 in 4 times the volume`."""
        larger = f" in {self.volume} times the volume" if self.volume > 1 else ""
        return f"{self.string}{larger}"


def number_in_volume(string: int, volume: int) -> int:
    """Return the number of a string in a control volume."""
    return string if volume == 1 else volume * STRING_STRIDE + string


def volume_string(number: int) -> VolumeString:
    """Return the control volume and the string of a number."""
    volume, string = divmod(number, STRING_STRIDE)
    return VolumeString(max(1, volume), string)


def volumes_of(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the control volumes of numbers of strings, (n,)."""
    return np.maximum(1, numbers // STRING_STRIDE)
