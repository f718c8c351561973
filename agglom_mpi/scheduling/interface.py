"""Interface of the scheduler: the campaign as it sees it, and the tasks that it assigns."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray


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
    0, to store that many frames of each.
    """
    return np.dtype(
        [
            ("string", "i8"),
            ("first", "i8"),
            ("count", "i8"),
            ("frames", "i8"),
            ("parameters", "f8", variables),
        ]
    )


def new_tasks(strings: Sequence[NDArray[np.float64]]) -> NDArray[np.void]:
    """Return tasks with the parameters of strings, (k,) each, and all else 0, (n,)."""
    tasks = np.zeros(len(strings), task_type(len(strings[0]) if len(strings) else 0))
    if len(strings):
        tasks["parameters"] = strings
    return tasks


MOST_SAMPLES: Final = 1024
"""Largest number of samples in one message."""


def runs(flags: NDArray[np.bool_]) -> list[slice]:
    """Return the places, consecutive ones together, at which flags, (n,), are set."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    return [slice(start, stop) for start, stop in edges.reshape(-1, 2).tolist()]
