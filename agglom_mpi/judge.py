"""Where the samples of a string suffice, decided in compiled code by whoever simulates them.

A judge has the numbers of a stopping rule and of an objective of the mean radius, and the running
means of a string. Operations and their order are those of `search.sample_paths`, by which rank 0
decides: both end a string at the same sample.
"""

from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.compilation.stages import inlined

MEAN_RADIUS: Final = 0
OBJECTIVE: Final = 1
HALF_WIDTH: Final = 2
"""What a rule compares: a change of the mean radius, or of the objective, relative to itself; or
half the 95 % interval of the objective."""

MEANS: Final = np.dtype(
    [("completed", "i8"), ("ratio", "f8"), ("deviation", "f8"), ("squares", "f8")]
)
"""Number of completed samples; means of b^f/b⁰ and of what the objective is the magnitude of; sum
of the squared distances from that."""

JUDGE: Final = np.dtype(
    [
        *MEANS.descr,
        ("asked", "?"),
        ("compares", "i8"),
        ("tolerance", "f8"),
        ("fewest", "i8"),
        ("reference", "f8"),
        ("magnitudes", "?"),
        ("decided", "?"),
    ]
)
"""Running means; whether they decide anything; what is compared with which tolerance, from how many
completed samples on; b^f/b⁰ at which a sample's deviation is 0, and whether its magnitude counts;
whether the string needs no more samples."""


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


def new_judge() -> Judge:
    """Return a judge that is never asked."""
    return Judge(np.zeros(1, JUDGE), np.zeros(0))


@inlined
def decides(judge, completed, ratio):
    """Take one more sample by its b^f/b⁰, if completed; return whether no other one is needed.

    After a failed one the judge is not asked any more: their share may end a string, too.
    """
    state = judge.state[0]
    if state["asked"]:
        if completed:
            state["decided"] = holds(judge, state, ratio)
        else:
            state["asked"] = False
    return state["decided"]


@inlined
def holds(judge, state, new):
    """Add a sample by its b^f/b⁰; return whether the rule holds after it."""
    ratio, deviation = state["ratio"], state["deviation"]
    follow(state, new)
    completed = state["completed"]
    if completed < max(2, state["fewest"]):
        return False
    if state["compares"] == HALF_WIDTH:
        error = np.sqrt(state["squares"] / (completed - 1) / completed)
        return judge.factors[completed] * error <= state["tolerance"]
    if state["compares"] == OBJECTIVE:
        return has_settled(abs(deviation), abs(state["deviation"]), state["tolerance"])
    return has_settled(ratio, state["ratio"], state["tolerance"])


@inlined
def follow(state, ratio):
    """Add a sample by its b^f/b⁰ to the running means, as `search.mean_paths` does."""
    deviation = ratio / state["reference"] - 1.0
    if state["magnitudes"]:
        deviation = abs(deviation)
    count = state["completed"] + 1
    state["completed"] = count
    if count == 1:
        state["ratio"] = ratio
        state["deviation"] = deviation
        return
    state["ratio"] += (ratio - state["ratio"]) / count
    distance = deviation - state["deviation"]
    state["deviation"] += distance / count
    state["squares"] += distance * (deviation - state["deviation"])


@inlined
def has_settled(before, after, tolerance):
    """Return whether a quantity changed by at most a share of itself, elementwise."""
    # Not a strict inequality, as [A 25, 27] print it: a quantity that stays at 0 has settled, and
    # so has an objective that stays at inf.
    return (before == after) | (abs(after - before) <= tolerance * abs(after))


def samples_needed(judge: Judge, completed: NDArray[np.bool_], ratios: NDArray[np.float64]) -> int:
    """Give a judge consecutive samples until it decides; return how many it has taken.

    Parameters
    ----------
    judge
        Its state goes on.
    completed, ratios
        Whether each sample completed, and its b^f/b⁰, (n,).
    """
    taken: int = _compiled()(judge, completed, np.ascontiguousarray(ratios))
    return taken


@cache
def _compiled() -> Any:
    from agglom_mpi.compilation.kernels import kernel

    return kernel(take_samples)


def take_samples(judge, completed, ratios):
    """Do the work of `samples_needed`."""
    for k in range(len(ratios)):
        if decides(judge, completed[k], ratios[k]):
            return k + 1
    return len(ratios)
