"""Where the samples of a string suffice, decided in compiled code.

A judge has the numbers of a stopping rule and of an objective of the mean radius, and the running
means of a string. Whoever simulates a string asks it after each sample, rank 0 when the samples
have arrived: both end the string at the same sample. Operations and their order are those of
`Ensemble.add`.
"""

import math
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.compilation.stages import compiler_is_loaded, inlined

MEAN_RADIUS: Final = 0
OBJECTIVE: Final = 1
HALF_WIDTH: Final = 2
NOTHING: Final = 3
"""What a rule compares: a change of the mean radius, or of the objective, relative to itself; or
half the 95 % interval of the objective; or nothing, where it holds after no sample."""

WORTH_COMPILING: Final = 50_000
"""Number of samples that take as long in Python as to load the compiler, half a second: who only
looks at a small campaign does without."""


class EnsembleMeans(NamedTuple):
    """Running means of the completed samples of a string: they lead to the next ones."""

    completed: int = 0
    """Number of completed samples."""
    ratio: float = math.nan
    """Mean of b^f/b⁰ over samples; nan without any, as the other means."""
    deviation: float = math.nan
    """Mean over samples of the quantity whose magnitude is the objective."""
    squares: float = 0.0
    """Sum of the squared distances from that mean."""
    grains: float = math.nan
    """Mean over samples of the grains per particle left."""


MEANS: Final = np.dtype(
    [("completed", "i8"), *((name, "f8") for name in EnsembleMeans._fields[1:])]
)
"""Record of `EnsembleMeans`."""

JUDGE: Final = np.dtype(
    [
        *MEANS.descr,
        ("particles", "i8"),
        ("asked", "?"),
        ("compares", "i8"),
        ("tolerance", "f8"),
        ("fewest", "i8"),
        ("reference", "f8"),
        ("magnitudes", "?"),
        ("decided", "?"),
    ]
)
"""Running means; particles at the start of a sample; whether anything is decided; what is compared
with which tolerance, from how many completed samples on; b^f/b⁰ at which a sample's deviation is 0,
and whether its magnitude counts; whether the string needs no more samples."""


class Judge(NamedTuple):
    """What decides how many samples a string needs.

    Attributes
    ----------
    state
        `JUDGE`, shape (1,).
    factors
        t of the 95 % interval of a mean over 0, 1, 2, … samples, as many as there may be; (0,)
        where it is not compared.
    """

    state: NDArray[Any]
    factors: NDArray[np.float64]

    @property
    def is_decided(self) -> bool:
        """Whether the string needs no more samples."""
        return bool(self.state["decided"][0])


def new_judge() -> Judge:
    """Return a judge that is never asked."""
    return Judge(np.zeros(1, JUDGE), np.zeros(0))


@inlined
def decides(judge, completed, ratio, left):
    """Take one more sample by its b^f/b⁰ and the particles left, if it is completed.

    Returns whether no other one is needed. After a failed one the judge is not asked any more:
    their share may end a string, too.
    """
    state = judge.state[0]
    if state["asked"]:
        if completed:
            state["decided"] = holds(judge, state, ratio, left)
        else:
            state["asked"] = False
    return state["decided"]


@inlined
def holds(judge, state, new, left):
    """Add a sample by its b^f/b⁰ and the particles left; return whether the rule holds after it."""
    ratio, deviation = state["ratio"], state["deviation"]
    follow(state, new, left)
    completed = state["completed"]
    if completed < max(2, state["fewest"]) or state["compares"] == NOTHING:
        return False
    if state["compares"] == HALF_WIDTH:
        error = np.sqrt(state["squares"] / (completed - 1) / completed)
        return judge.factors[completed] * error <= state["tolerance"]
    if state["compares"] == OBJECTIVE:
        return has_settled(abs(deviation), abs(state["deviation"]), state["tolerance"])
    return has_settled(ratio, state["ratio"], state["tolerance"])


@inlined
def follow(state, ratio, left):
    """Add a sample by its b^f/b⁰ and the particles left to the running means."""
    deviation = ratio / state["reference"] - 1.0
    if state["magnitudes"]:
        deviation = abs(deviation)
    grains = state["particles"] / left
    count = state["completed"] + 1
    state["completed"] = count
    if count == 1:
        state["ratio"] = ratio
        state["deviation"] = deviation
        state["grains"] = grains
        return
    state["ratio"] += (ratio - state["ratio"]) / count
    state["grains"] += (grains - state["grains"]) / count
    distance = deviation - state["deviation"]
    state["deviation"] += distance / count
    state["squares"] += distance * (deviation - state["deviation"])


@inlined
def has_settled(before, after, tolerance):
    """Return whether a quantity changed by at most a share of itself, elementwise."""
    # Not a strict inequality, as [A 25, 27] print it: a quantity that stays at 0 has settled, and
    # so has an objective that stays at inf.
    return (before == after) | (abs(after - before) <= tolerance * abs(after))


def samples_needed(
    judge: Judge,
    completed: NDArray[np.bool_],
    ratios: NDArray[np.float64],
    left: NDArray[np.int64],
) -> int:
    """Give a judge consecutive samples until it decides; return how many it has taken.

    Parameters
    ----------
    judge
        Its state goes on.
    completed, ratios, left
        Whether each sample completed, its b^f/b⁰, and its particles left, (n,).
    """
    return _LOOP(judge, completed, np.ascontiguousarray(ratios), np.ascontiguousarray(left))


def take_samples(judge, completed, ratios, left):
    """Do the work of `samples_needed`."""
    for k in range(len(ratios)):
        if decides(judge, completed[k], ratios[k], left[k]):
            return k + 1
    return len(ratios)


class _Loop:
    """The loop `take_samples`, compiled where that saves time."""

    def __init__(self) -> None:
        self._samples = 0  # so far

    def __call__(self, judge: Judge, *columns: NDArray[Any]) -> int:
        self._samples += len(columns[0])
        if compiler_is_loaded() or self._samples > WORTH_COMPILING:
            return int(_compiled()(judge, *columns))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            return int(take_samples(judge, *columns))


_LOOP: Final = _Loop()


@cache
def _compiled() -> Any:
    from agglom_mpi.compilation.kernels import kernel

    return kernel(take_samples)


def compile_loop() -> bool:
    """Compile the loop ahead of a run, or load it; return whether it was compiled."""
    from agglom_mpi.compilation.kernels import compile_ahead, runs_compiled

    arguments = new_judge(), np.zeros(0, np.bool_), np.zeros(0), np.zeros(0, np.int64)
    return runs_compiled() and compile_ahead(_compiled(), arguments)
