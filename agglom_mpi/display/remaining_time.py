"""Forecast of the remaining time of repeated work, with its error."""

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

from agglom_mpi.statistics import RunningMean, t_95

MIN_DURATIONS: Final = 3
"""Durations before there is a forecast: of two the 95 % interval is hundreds of times wider than
they differ."""

ROUNDING_STEPS: Final = tuple(
    size * step
    for size, steps in (
        (1, (1, 2, 5, 10, 20, 30)),
        (60, (1, 2, 5, 10, 20, 30)),
        (3600, (1, 2, 4, 8, 12)),
        (86400, (1, 2, 5, 10, 20, 50, 100)),
    )
    for step in steps
)
"""Steps that a time is rounded to, s."""

UNITS: Final = ((86400, "d"), (3600, "h"), (60, "min"), (1, "s"))


class RemainingTime(NamedTuple):
    """A forecast of the remaining time, and half of its 95 % interval, s."""

    seconds: float
    half_width: float

    @property
    def is_bound(self) -> bool:
        """Whether only a maximum is known: the interval reaches down to zero."""
        return self.seconds <= self.half_width

    def __str__(self) -> str:
        """Return both, rounded to half of the error: `3 min 20 s ± 20 s`; of a bound the upper end.

        Coarser steps would shift the time by as much as its error.
        """
        step = max(
            (step for step in ROUNDING_STEPS if step <= self.half_width / 2.0),
            default=ROUNDING_STEPS[0],
        )
        if self.is_bound:
            return format_rounded(math.ceil((self.seconds + self.half_width) / step) * step, step)
        error = max(self.half_width, step)
        return f"{format_rounded(self.seconds, step)} ± {format_rounded(error, step)}"


class DurationStatistics(RunningMean):
    """Mean and standard deviation of durations in s that are added one by one."""

    def __init__(self, durations: Iterable[float] = ()) -> None:
        super().__init__()
        for duration in durations:
            self.add(duration)

    @property
    def deviation(self) -> float:
        """Standard deviation, s; nan of fewer than two durations."""
        return math.sqrt(self.squares / (self.count - 1)) if self.count > 1 else math.nan


def remaining_in_turns(
    durations: DurationStatistics, turns: int, elapsed: float = 0.0
) -> RemainingTime | None:
    """Forecast the duration of the remaining turns of work that is done one turn after another.

    If durations are independent and normal, with the mean d of n of them and their standard
    deviation s, the sum of m more is m d ± t s √(m + m²/n), the t of n - 1 degrees of freedom:
    the scatter of the remaining turns, and of the mean.

    Parameters
    ----------
    durations
        Of the finished turns.
    turns
        Number of remaining turns, the present one included.
    elapsed
        Time that the present turn has taken, s; beyond the mean duration it is not foreseen.

    Returns
    -------
    RemainingTime or None
        None if fewer than three turns are finished, or none remains.
    """
    if durations.count < MIN_DURATIONS or turns < 1:
        return None
    deviation = durations.deviation * math.sqrt(turns + turns**2 / durations.count)
    return RemainingTime(
        turns * durations.mean - min(elapsed, durations.mean),
        t_95(durations.count - 1) * deviation,
    )


def remaining_by_work(
    costs: DurationStatistics, done: int, rest: int, elapsed: float
) -> RemainingTime | None:
    """Forecast the duration of the remaining pieces of work that is done by several ranks.

    The rate stays what it was; its error follows from how much the pieces differ.

    Parameters
    ----------
    costs
        Durations of single pieces on one rank; only their relative deviation counts.
    done, rest
        Number of pieces done in `elapsed` seconds, and of remaining pieces.
    elapsed
        s.

    Returns
    -------
    RemainingTime or None
        None if fewer than three pieces are done, or none remains.
    """
    if min(costs.count, done) < MIN_DURATIONS or rest < 1 or costs.mean <= 0.0:
        return None
    seconds = elapsed * rest / done
    relative = costs.deviation / costs.mean * math.sqrt(1.0 / rest + 1.0 / done)
    return RemainingTime(seconds, t_95(costs.count - 1) * seconds * relative)


def format_rounded(seconds: float, step: int) -> str:
    """Return a time in its two largest units, rounded to multiples of `step` s: `1 h 2 min`."""
    rest = round(max(0.0, seconds) / step) * step
    words: list[str] = []
    for size, unit in UNITS:
        if rest >= size and len(words) < 2:
            words.append(f"{rest // size} {unit}")
            rest %= size
        elif words:
            break
    return " ".join(words) or "0 s"
