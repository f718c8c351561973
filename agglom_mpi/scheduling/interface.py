"""What the scheduler asks of a campaign; `search.inversion.Inversion` answers it."""

from collections.abc import Mapping, Sequence
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.variables import COUNT


class Progress(Protocol):
    """How far the ensemble of a string is."""

    @property
    def next_sample(self) -> int:
        """Samples judged so far."""

    @property
    def max_samples(self) -> int:
        """Most samples."""


class SampleDemand(Protocol):
    """A campaign: its strings, and which of them need samples."""

    @property
    def generation(self) -> int:
        """Number of the generation that is being judged."""

    @property
    def live(self) -> Mapping[int, Progress]:
        """Strings of this generation that are not judged yet."""

    @property
    def unjudged(self) -> int:
        """Number of strings in `live`."""

    def progress(self, string: int) -> Progress | None:
        """How far a live or announced string is; None once it is judged."""

    def used(self, string: int) -> int:
        """Return the number of samples that a judged string needed."""

    def parameters(self, string: int) -> NDArray[np.float64]:
        """Return a proposed string, shape (10,)."""

    def announce(self, generations: int) -> Sequence[int]:
        """Propose strings of one more coming generation, at most so many ahead of this one.

        Those that depend on no result; none, if there are none or they are all announced.
        """


TASK: Final = np.dtype(
    [
        ("string", "i8"),
        ("first", "i8"),
        ("count", "i8"),
        ("frames", "i8"),
        ("parameters", "f8", COUNT),
    ]
)
"""Samples `first` to `first + count - 1` of a string to simulate; or, if `frames` is not 0, to take
so many pictures of each."""


MOST_SAMPLES: Final = 1024
"""Samples asked for in one message at most."""
