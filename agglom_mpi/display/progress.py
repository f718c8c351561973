"""Progress of a run as a log line and as lines on a terminal, and its remaining time."""

import math
from collections.abc import Iterable
from itertools import chain
from typing import TYPE_CHECKING, Final, NamedTuple

from agglom_mpi.formatting import encodable, pluralise, value_with_error
from agglom_mpi.statistics import RunningMean, t_95

if TYPE_CHECKING:
    from rich.text import Text

    from agglom_mpi.search.proposals import GenerationSummary


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


MAX_BAR_WIDTH: Final = 40
MIN_BAR_WIDTH: Final = 8
SEPARATOR: Final = "  "
"""Between phrases on a terminal."""


class Best(NamedTuple):
    """The best string after a generation, and the mean objective of the best few."""

    string: int
    objective: float
    standard_error: float
    mean_of_top: float
    estimated: bool = False
    """Whether the objective is the search's own estimate, not that of the string's samples."""

    def __str__(self) -> str:
        """Return it as `0.0123 ± 0.0045 (string 762)`; `source` is to follow."""
        value = value_with_error(self.objective, self.standard_error)
        return f"{value} (string {self.string})"

    @property
    def source(self) -> str:
        """Label that distinguishes this objective from that in the table; empty if they agree."""
        return "as the search estimates" if self.estimated else ""


def best_of(summary: "GenerationSummary") -> Best:
    """Return the best string of a generation."""
    values = summary.objective, summary.standard_error, summary.mean_of_top
    return Best(summary.best, *values, summary.estimated)


class RunProgress(NamedTuple):
    """The state of a run; None stands for what is not known.

    Attributes
    ----------
    done, total, unit
        Work done in this phase, such as `12` of `100` `generations`.
    elapsed
        Wall-clock time of this leg, s.
    samples
        Samples simulated so far, of all legs.
    rate, busy
        Samples per second of this leg, and share of its ranks' time spent on them.
    strings_open
        Strings that need more samples.
    in_flight
        Maximum number of samples that ranks simulate or have queued; not in the campaign file.
    failed
        Samples that failed, of all legs.
    remaining, may_end_sooner
        Time that this phase still takes, and whether a target may end it sooner.
    note
        Anything else to show.
    """

    done: int
    total: int
    unit: str
    elapsed: float
    samples: int
    rate: float | None = None
    busy: float | None = None
    strings_open: int = 0
    in_flight: int | None = None
    failed: int = 0
    best: Best | None = None
    remaining: RemainingTime | None = None
    may_end_sooner: bool = False
    note: str = ""


Phrase = tuple[str, str]
"""Some words and their rich style."""


def phrases(progress: RunProgress) -> tuple[list[Phrase], list[Phrase], list[Phrase]]:
    """Return three groups of phrases: progress and time, quality of the best, rate."""
    best, left = progress.best, progress.remaining
    time = [(f"{progress.done}/{progress.total} {progress.unit}", "bold")]
    if progress.elapsed:
        time.append((format_clock(progress.elapsed), ""))
    if left is not None:
        bound = "at most " if progress.may_end_sooner or left.is_bound else ""
        time.append((f"left {bound}{left}", ""))
    quality: list[Phrase] = []
    if best is not None:
        quality.append((f"best {best}", "green"))
        if best.source:
            quality.append((best.source, "green"))
        if math.isfinite(best.mean_of_top):
            quality.append((f"mean of top {best.mean_of_top:.3g}", ""))
    if progress.failed:
        quality.append((f"{pluralise(progress.failed, 'sample')} failed", "red"))
    rate: list[Phrase] = []
    if progress.samples:
        rate.append((pluralise(progress.samples, "sample"), ""))
    if progress.rate is not None:
        rate.append((format_rate(progress.rate), ""))
    if progress.busy is not None:
        rate.append((f"{progress.busy:.0%} busy", ""))
    if progress.strings_open:
        rate.append((f"{pluralise(progress.strings_open, 'string')} open", ""))
    if progress.in_flight is not None:
        rate.append((f"{progress.in_flight} in flight", ""))
    if progress.note:
        rate.append((progress.note, "yellow"))
    return time, quality, rate


def log_line(progress: RunProgress) -> str:
    """Return all phrases in one line."""
    return ", ".join(words for words, _ in chain(*phrases(progress)))


def terminal_lines(progress: RunProgress, width: int, encoding: str = "utf-8") -> "list[Text]":
    """Return all phrases in lines for a terminal, with a bar where there is room.

    Parameters
    ----------
    progress
    width
        Columns of the terminal; all lines are shorter.
    encoding
        Of the terminal; characters that it lacks are spelled out.
    """
    room = max(1, width - 1)
    time, quality, rate = (
        [(encodable(words, encoding), style) for words, style in group]
        for group in phrases(progress)
    )
    used = len(SEPARATOR.join(words for words, _ in time)) + len(SEPARATOR)
    if room - used >= MIN_BAR_WIDTH:
        time[2:2] = _bar(progress, min(MAX_BAR_WIDTH, room - used), encoding)
    return [line for group in (time, quality, rate) for line in _wrapped(group, room)]


def _bar(progress: RunProgress, width: int, encoding: str) -> list[Phrase]:
    """Return a bar whose full part shows the share that is done."""
    full = round(width * min(1.0, progress.done / max(1, progress.total)))
    return [(encodable("━" * full, encoding) + encodable("─" * (width - full), encoding), "cyan")]


def _wrapped(group: list[Phrase], room: int) -> "list[Text]":
    """Return phrases in lines that break between phrases only; a longer phrase is cut."""
    from rich.text import Text  # not needed by the recorder of a run and what reads it

    found: list[Text] = []
    for words, style in group:
        if found and len(found[-1]) + len(SEPARATOR) + len(words) <= room:
            found[-1].append(SEPARATOR)
        else:
            found.append(Text())
        found[-1].append(words[:room].rstrip(), style)
    return found


def format_rate(rate: float) -> str:
    """Return a rate per second: `705/s`, `1.3/s`, `0.025/s`."""
    return f"{rate:.0f}/s" if rate >= 10.0 else f"{rate:.2g}/s"


def format_clock(seconds: float) -> str:
    """Return a time as a clock shows it: `0:07`, `1:02:03`."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
