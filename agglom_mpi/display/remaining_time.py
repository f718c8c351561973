"""How long something will take that is done in many similar turns, and how sure that is."""

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

from agglom_mpi.statistics import t_95

LEAST_LAPS: Final = 3
"""Turns before anything is said: of two the 95 % interval is hundreds of times their scatter."""

STEPS: Final = tuple(
    size * step
    for size, steps in (
        (1, (1, 2, 5, 10, 20, 30)),
        (60, (1, 2, 5, 10, 20, 30)),
        (3600, (1, 2, 4, 8, 12)),
        (86400, (1, 2, 5, 10, 20, 50, 100)),
    )
    for step in steps
)
"""Seconds that a time is rounded to."""

UNITS: Final = ((86400, "d"), (3600, "h"), (60, "min"), (1, "s"))


class RemainingTime(NamedTuple):
    """Time left, and half its 95 % interval, both in s."""

    seconds: float
    error: float

    def __str__(self) -> str:
        """Say both, rounded to what the error leaves of them: `3 min 20 s ± 20 s`."""
        step = max((step for step in STEPS if step <= self.error), default=STEPS[0])
        return f"{in_units(self.seconds, step)} ± {in_units(max(self.error, step), step)}"


class DurationStatistics:
    """Mean and scatter of durations, s, taken one by one (Welford).

    Attributes
    ----------
    count
        Durations taken.
    mean
        Their mean, s.
    """

    def __init__(self, durations: Iterable[float] = ()) -> None:
        self.count = 0
        self.mean = 0.0
        self._squares = 0.0
        for duration in durations:
            self.add(duration)

    def add(self, duration: float) -> None:
        """Take one more."""
        self.count += 1
        off = duration - self.mean
        self.mean += off / self.count
        self._squares += off * (duration - self.mean)

    @property
    def deviation(self) -> float:
        """Standard deviation, s; nan of fewer than two."""
        return math.sqrt(self._squares / (self.count - 1)) if self.count > 1 else math.nan


def remaining_in_turns(
    laps: DurationStatistics, turns: int, elapsed: float = 0.0
) -> RemainingTime | None:
    """Forecast how long so many more turns take, from how long each took so far.

    If durations are independent and normal, with the mean d of n of them and their standard
    deviation s, the sum of m more is m d ± t s √(m + m²/n), the t of n - 1 degrees of freedom:
    scatter of what is to come, and of what the mean was taken from.

    Parameters
    ----------
    laps
        How long turns took.
    turns
        Turns to come, the one that is under way included.
    elapsed
        Seconds that the one under way has taken; what it takes beyond the mean is unforeseen.

    Returns
    -------
    Left or None
        With its 95 % interval; None while too few turns are known.
    """
    if laps.count < LEAST_LAPS or turns < 1:
        return None
    spread = laps.deviation * math.sqrt(turns + turns**2 / laps.count)
    return RemainingTime(turns * laps.mean - min(elapsed, laps.mean), t_95(laps.count - 1) * spread)


def remaining_by_work(
    costs: DurationStatistics, done: int, rest: int, elapsed: float
) -> RemainingTime | None:
    """Forecast how long the rest of many pieces takes that are done by several at a time.

    It goes on at the pace so far; how sure that is follows from how much the pieces differ.

    Parameters
    ----------
    costs
        What single pieces cost, s, done by one; only their relative scatter counts.
    done, rest
        Pieces done in `elapsed` seconds, and pieces to do.
    """
    if min(costs.count, done) < LEAST_LAPS or rest < 1 or costs.mean <= 0.0:
        return None
    seconds = elapsed * rest / done
    spread = costs.deviation / costs.mean * math.sqrt(1.0 / rest + 1.0 / done)
    return RemainingTime(seconds, t_95(costs.count - 1) * seconds * spread)


def in_units(seconds: float, step: int) -> str:
    """Say a time in its two largest units, rounded to multiples of `step` s."""
    rest = round(max(0.0, seconds) / step) * step
    words: list[str] = []
    for size, unit in UNITS:
        if rest >= size and len(words) < 2:
            words.append(f"{rest // size} {unit}")
            rest %= size
        elif words:
            break
    return " ".join(words) or "0 s"
