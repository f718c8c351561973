"""Running means of many ensembles, followed through arrays of values by one compiled loop.

The means after each value have the bits that `RunningMean.add` gives, as decisions rest on them.
"""

from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.compilation.stages import compiler_is_loaded

WORTH_COMPILING: Final = 500_000
"""Number of values that take as long in Python as to load the compiler, half a second: who only
looks at a small campaign does without."""

Counts = NDArray[np.int64]
Floats = NDArray[np.float64]


class MeanPaths(NamedTuple):
    """Running means of m ensembles, before and after each of their n values: n + m states.

    The states of an ensemble lie one behind the other, those of the next ensemble after them.

    Attributes
    ----------
    counts
        Number of values so far, (n + m,).
    means, squares
        Means of each of q numbers, and sums of the squared distances from them, (q, n + m).
    """

    counts: Counts
    means: Floats
    squares: Floats


def follow_means(
    values: Floats, sizes: Counts, counts: Counts, means: Floats, squares: Floats, paths: MeanPaths
) -> None:
    """Fill the paths, a `MeanPaths`; the other arguments are those of `mean_paths`."""
    begin = 0
    for ensemble in range(len(sizes)):
        size = sizes[ensemble]
        state = begin + ensemble
        for step in range(size + 1):
            paths.counts[state + step] = counts[ensemble] + step
        for number in range(len(values)):
            count, mean = counts[ensemble], means[ensemble, number]
            total = squares[ensemble, number]
            paths.means[number, state], paths.squares[number, state] = mean, total
            for step in range(size):
                count += 1
                value = values[number, begin + step]
                if count == 1:
                    mean = value
                else:
                    distance = value - mean
                    mean += distance / count
                    total += distance * (value - mean)
                paths.means[number, state + step + 1] = mean
                paths.squares[number, state + step + 1] = total
        begin += size


class _Loop:
    """The loop `follow_means`, compiled where that saves time."""

    def __init__(self) -> None:
        self._values = 0  # so far

    def __call__(self, values: Floats, *others: Any) -> None:
        self._values += values.size
        compiled = compiler_is_loaded() or self._values > WORTH_COMPILING
        (_compiled() if compiled else follow_means)(values, *others)


@cache
def _compiled() -> Any:
    from agglom_mpi.compilation.kernels import kernel

    return kernel(follow_means)


_LOOP: Final = _Loop()


def compile_loop() -> bool:
    """Compile the loop ahead of a run, or load it; return whether it was compiled."""
    from agglom_mpi.compilation.kernels import compile_ahead, runs_compiled

    numbers, whole = np.zeros((1, 1)), np.zeros(1, np.int64)
    paths = MeanPaths(whole, numbers, numbers)
    arguments = numbers, whole, whole, numbers, numbers, paths
    return runs_compiled() and compile_ahead(_compiled(), arguments)


def mean_paths(
    values: Floats, sizes: list[int], counts: list[int], means: Floats, squares: Floats
) -> MeanPaths:
    """Return the means of ensembles before and after each of their values.

    Parameters
    ----------
    values
        Each of q numbers of n values, those of one ensemble after those of another, (q, n).
    sizes
        Number of the values of each of m ensembles.
    counts, means, squares
        Number of values before these, their means and sums of squared distances, the arrays of
        shape (m, q). The mean of no values may be anything.
    """
    states = values.shape[1] + len(sizes)
    shape = len(values), states
    paths = MeanPaths(np.empty(states, np.int64), np.empty(shape), np.empty(shape))
    whole_sizes, whole_counts = np.array(sizes, np.int64), np.array(counts, np.int64)
    _LOOP(np.ascontiguousarray(values), whole_sizes, whole_counts, means, squares, paths)
    return paths
