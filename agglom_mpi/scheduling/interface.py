"""Interface of the scheduler: the campaign as it sees it, the tasks, and the numbers of strings.

A sample of a string in `volume` times the campaign's box has the string number
`volume * STRING_STRIDE + string` while it is in flight, and in `/failures`. So schedulers, messages
and ranks treat it as a sample of one more string. Volume 1, the campaign's own box, adds nothing.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.judge import MEANS, EnsembleMeans

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


class StringProgress(Protocol):
    """Samples used and allowed of a string."""

    @property
    def next_sample(self) -> int:
        """Samples used so far, hence the number of the one that is needed next."""

    @property
    def max_samples(self) -> int:
        """Largest number of samples."""


class SampleDemand(Protocol):
    """Which strings of a campaign need samples; `search.inversion.Inversion` is one."""

    @property
    def generation(self) -> int:
        """Number of the generation under way."""

    @property
    def open_strings(self) -> Mapping[int, StringProgress]:
        """Strings of this generation that need samples."""

    @property
    def open_count(self) -> int:
        """Number of strings in `open_strings`."""

    def progress(self, string: int) -> StringProgress | None:
        """Return the progress of an open string or one proposed ahead; None once it is complete."""

    def judged_from(self, string: int) -> EnsembleMeans | None:
        """Return the running means of a live string that ranks may end; None if they may not."""

    def samples_used(self, string: int) -> int:
        """Return the number of samples that a complete string has used."""

    def parameters(self, string: int) -> NDArray[np.float64]:
        """Return a proposed string in SI units, shape (k,)."""


ProposeAhead = Callable[[int], Sequence[int]]
"""Proposes strings of one more coming generation that depend on no further result. The argument is
the maximum number of generations ahead; returns the numbers of the strings, perhaps none."""


@cache
def task_type(variables: int) -> np.dtype:
    """Return the record type of a task, for strings of k = `variables` numbers.

    A task is samples `first` to `first + count - 1` of a string to simulate; or, if `frames` is not
    0, to store that many frames of each. Where they are `judged`, the rank leaves out those after
    the one that was the last one needed, given the `means` of the samples before the first.
    """
    return np.dtype(
        [
            ("string", "i8"),
            ("first", "i8"),
            ("count", "i8"),
            ("frames", "i8"),
            ("judged", "i8"),
            ("means", MEANS),
            ("parameters", "f8", variables),
        ]
    )


def means_of(task: np.void) -> EnsembleMeans:
    """Return the running means of the samples before the first of a task that is judged."""
    return EnsembleMeans._make(task["means"].item())


def new_tasks(strings: Sequence[NDArray[np.float64]]) -> NDArray[np.void]:
    """Return tasks with the parameters of strings, (k,) each, and all else 0, (n,)."""
    tasks = np.zeros(len(strings), task_type(len(strings[0]) if len(strings) else 0))
    if len(strings):
        tasks["parameters"] = strings
    return tasks


class ReturnedPart(NamedTuple):
    """What a rank has done of the next range that it was given: its first samples, in order."""

    string: int
    first: int
    size: int
    left_out: bool
    """Whether it leaves out the others, which are not needed."""


MOST_SAMPLES: Final = 1024
"""Largest number of samples in one message."""


def runs(flags: NDArray[np.bool_]) -> list[slice]:
    """Return the places, consecutive ones together, at which flags, (n,), are set."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    return [slice(start, stop) for start, stop in edges.reshape(-1, 2).tolist()]
