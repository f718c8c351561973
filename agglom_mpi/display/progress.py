"""How far a run is, and the lines that say so."""

import math
from itertools import chain
from typing import TYPE_CHECKING, Final, NamedTuple

from agglom_mpi.display.remaining_time import RemainingTime
from agglom_mpi.formatting import encodable, pluralise, value_with_error

if TYPE_CHECKING:
    from rich.text import Text


WIDEST_BAR: Final = 40

NARROWEST_BAR: Final = 8

BETWEEN: Final = "  "
"""What separates phrases on a terminal."""


class Best(NamedTuple):
    """The best string after a generation, and the mean objective of the best few."""

    string: int
    objective: float
    standard_error: float
    mean_of_top: float


class Progress(NamedTuple):
    """What is known now of a run; None where nothing is.

    Attributes
    ----------
    done, total, unit
        How far it is: `12` of `100` `generations`, or of another phase.
    elapsed
        Seconds of this leg.
    samples
        Samples simulated so far, of all legs.
    rate, busy
        Samples per second of this leg, and share of its ranks' time spent on them.
    strings_open
        Strings that wait for more samples to be judged.
    in_flight
        Samples that ranks simulate or have waiting; the campaign file does not know.
    failed
        Samples that failed, of all legs.
    left, at_most
        Time that this phase takes; whether it may end sooner.
    note
        What else there is to say.
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
    left: RemainingTime | None = None
    at_most: bool = False
    note: str = ""


Phrase = tuple[str, str]
"""Words, and the style they are shown in."""


def phrases(progress: Progress) -> tuple[list[Phrase], list[Phrase], list[Phrase]]:
    """Say what is known: how far and how long, how good, how fast."""
    far = [(f"{progress.done}/{progress.total} {progress.unit}", "bold")]
    if progress.elapsed:
        far.append((clock(progress.elapsed), ""))
    if progress.left is not None:
        far.append((f"left {'at most ' if progress.at_most else ''}{progress.left}", ""))
    good: list[Phrase] = []
    if (best := progress.best) is not None:
        value = value_with_error(best.objective, best.standard_error)
        good = [(f"best {value} (string {best.string})", "green")]
        if math.isfinite(best.mean_of_top):
            good.append((f"mean of top {best.mean_of_top:.3g}", ""))
    if progress.failed:
        good.append((f"{pluralise(progress.failed, 'sample')} failed", "red"))
    fast = [(pluralise(progress.samples, "sample"), "")] if progress.samples else []
    if progress.rate is not None:
        fast.append((per_second(progress.rate), ""))
    if progress.busy is not None:
        fast.append((f"{progress.busy:.0%} busy", ""))
    if progress.strings_open:
        fast.append((f"{pluralise(progress.strings_open, 'string')} open", ""))
    if progress.in_flight is not None:
        fast.append((f"{progress.in_flight} in flight", ""))
    if progress.note:
        fast.append((progress.note, "yellow"))
    return far, good, fast


def in_words(progress: Progress) -> str:
    """Say what is known in one line, for a log."""
    return ", ".join(words for words, _ in chain(*phrases(progress)))


def lines(progress: Progress, width: int, encoding: str = "utf-8") -> "list[Text]":
    """Say what is known in lines of less than so many columns, with a bar where there is room."""
    room = max(1, width - 1)
    far, good, fast = (
        [(encodable(words, encoding), style) for words, style in group]
        for group in phrases(progress)
    )
    used = len(BETWEEN.join(words for words, _ in far)) + len(BETWEEN)
    if room - used >= NARROWEST_BAR:
        far[2:2] = bar(progress, min(WIDEST_BAR, room - used), encoding)
    return [line for group in (far, good, fast) for line in flowed(group, room)]


def bar(progress: Progress, width: int, encoding: str) -> list[Phrase]:
    """Draw how much is done."""
    full = round(width * min(1.0, progress.done / max(1, progress.total)))
    return [(encodable("━" * full, encoding) + encodable("─" * (width - full), encoding), "cyan")]


def flowed(group: list[Phrase], room: int) -> "list[Text]":
    """Break between phrases only; what is longer than a line is cut."""
    from rich.text import Text  # which the recorder of a run, and who reads it, does without

    found: list[Text] = []
    for words, style in group:
        if found and len(found[-1]) + len(BETWEEN) + len(words) <= room:
            found[-1].append(BETWEEN)
        else:
            found.append(Text())
        found[-1].append(words[:room].rstrip(), style)
    return found


def per_second(rate: float) -> str:
    """Say a rate: `705/s`, `1.3/s`, `0.025/s`."""
    return f"{rate:.0f}/s" if rate >= 10.0 else f"{rate:.2g}/s"


def clock(seconds: float) -> str:
    """Say a time as a clock does: `0:07`, `1:02:03`."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
