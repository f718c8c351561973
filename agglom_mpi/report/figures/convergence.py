"""How good the search became: objective against generation ([A] fig. 4, [B] fig. 4)."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import half_width
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.report.figures.axes import grid, legend_below, objective_label, say, whole_numbers
from agglom_mpi.report.picture import COLOURS, Picture
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import matplotlib.figure

Floats = NDArray[np.float64]

NORMAL: Final = 1.96
"""Half of a 95 % interval in standard errors, where many samples are behind it."""
LOGARITHMIC: Final = 15.0
"""Ratio of the largest to the smallest value from which the axis is logarithmic."""


class History(NamedTuple):
    """The search after each of G generations, arrays of shape (G,); widths are of 95 % intervals.

    Attributes
    ----------
    generation
        From 1.
    seconds
        Wall-clock time so far, s.
    best, best_half
        Objective of the best string as the search has it, and half its interval.
    top, top_half
        Mean objective of the best `tops` strings, and half its interval.
    tops
    """

    generation: NDArray[np.int64]
    seconds: Floats
    best: Floats
    best_half: Floats
    top: Floats
    top_half: Floats
    tops: int


def history(data: CampaignData) -> History:
    """Return the search after each generation that is there."""
    rows, result_of = data.generation_rows(), rank_strings(data).results
    best = [result_of.get(int(string)) for string in rows["best_string"]]
    counts = np.array([0 if r is None else r["samples_used"] - r["failed"] for r in best], int)
    tops = int(rows["top"][-1]) if len(rows) else 0
    errors = [_top_error(row, result_of) for row in rows]
    return History(
        generation=rows["generation"] + 1,
        seconds=rows["seconds"],
        best=_finite(rows["best_objective"]),
        best_half=half_width(rows["best_standard_error"], counts),
        top=_finite(rows["mean_of_top"]),
        top_half=NORMAL * np.array(errors, float),
        tops=tops,
    )


def _top_error(row: np.void, result_of: dict[int, np.void]) -> float:
    """Return the standard error of the mean of the top strings, whose samples are independent."""
    top = [result_of.get(int(string)) for string in row["population"][: row["top"]]]
    errors = [np.nan if result is None else result["standard_error"] for result in top]
    return float(np.linalg.norm(errors) / max(1, len(errors)))


def _finite(values: Floats) -> Floats:
    return np.where(np.isfinite(values), values, np.nan)


def draw_convergence(
    ax: Any,
    found: History,
    objective: str = "objective (1)",
    again: tuple[float, float, float] | None = None,
) -> Any:
    """Draw best and mean-of-top objective with 95 % bands, and return the axes.

    Parameters
    ----------
    again
        What the best string is worth on fresh samples, and the ends of its 95 % interval.
    """
    grid(ax)
    ax.set_xlabel("generation")
    ax.set_ylabel(objective)
    shown = [v for v in (*found.best, *found.top) if np.isfinite(v)]
    if not shown:
        say(ax, "no generation with a result yet")
        return ax
    curves = [("best string", found.best, found.best_half)]
    if found.tops > 1:  # of one it is the same
        curves.append((f"mean of the best {found.tops}", found.top, found.top_half))
    for (name, value, half), colour in zip(curves, COLOURS, strict=False):
        marker = "o" if len(value) < 30 else ""
        ax.plot(found.generation, value, color=colour, marker=marker, markersize=3.5, label=name)
        ax.fill_between(
            found.generation, value - half, value + half, color=colour, alpha=0.18, linewidth=0
        )
        if len(value) == 1:
            ax.errorbar(found.generation, value, half, color=colour, capsize=3)
    if again is not None:
        _draw_again(ax, found.generation[-1] + max(0.4, 0.015 * len(found.best)), again)
    _scale(ax, shown, again)
    ax.set_xlim(left=1.0 - 0.03 * max(10, len(found.best)))
    whole_numbers(ax.xaxis)
    legend_below(ax, 3)
    return ax


def _draw_again(ax: Any, x: float, again: tuple[float, float, float]) -> None:
    value, low, high = again
    ax.errorbar(
        x,
        value,
        [[value - low], [high - value]],
        color=COLOURS[6],
        marker="D",
        markersize=4,
        capsize=3,
        linestyle="none",
        label="best, on fresh samples",
    )


def _scale(ax: Any, shown: list[float], again: tuple[float, float, float] | None) -> None:
    """Use a logarithmic axis where values differ much; bands that reach 0 end at its edge."""
    values = [*shown, *(again[:1] if again else ())]
    low, high = min(values), max(values)
    if low > 0.0 and high > LOGARITHMIC * low:
        ax.set_yscale("log", nonpositive="clip")
        ax.set_ylim(bottom=0.3 * low)
    elif low >= 0.0:
        ax.set_ylim(bottom=max(0.0, ax.get_ylim()[0]))


def pictures(data: CampaignData) -> Iterator[Picture]:
    """Yield the picture of a campaign, if there is a generation to show."""
    found = history(data)
    if not np.isfinite(found.best).any():
        return

    def draw(figure: "matplotlib.figure.Figure") -> None:
        draw_convergence(figure.subplots(), found, objective_label(data), fresh_best(data))

    yield Picture(
        "convergence",
        "Objective of the best string and mean of the best strings after each generation, as the "
        "search had them, with 95 % bands ([A] fig. 4, [B] fig. 4). Lucky strings survive, so "
        "these are biased low; fresh samples are not.",
        draw,
    )


def fresh_best(data: CampaignData) -> tuple[float, float, float] | None:
    """Return the objective on fresh samples of the string that is the best, and its interval."""
    for estimate in rank_strings(data).estimates:
        if estimate.known and estimate.string == rank_strings(data).order[0]:
            return estimate.objective, estimate.lower, estimate.upper
    return None
