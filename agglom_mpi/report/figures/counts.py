"""How many samples a string took."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.report.figures.axes import grid, legend_below, say, whole_numbers
from agglom_mpi.report.picture import COLOURS, Picture
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import matplotlib.figure

BINS: Final = 30


def draw_counts(ax: Any, used: NDArray[np.int64], at_maximum: NDArray[np.bool_]) -> Any:
    """Draw how many of n strings took so many samples, and return the axes.

    Parameters
    ----------
    used
        Samples that each was judged by, shape (n,).
    at_maximum
        Which were ended by `max_samples` and not by their rule, shape (n,).
    """
    grid(ax)
    ax.set_xlabel("samples of a string")
    ax.set_ylabel("strings")
    if not len(used):
        say(ax, "no string is judged yet")
        return ax
    low, high = int(used.min()), int(used.max())
    width = max(1, -(-(high - low + 1) // BINS))
    edges = np.arange(low, high + width + 1, width) - 0.5
    parts = [("ended by the stopping rule", ~at_maximum), ("at max_samples", at_maximum)]
    parts = [part for part in parts if part[1].any()]
    ax.hist(
        [used[chosen] for _, chosen in parts],
        bins=edges,
        stacked=True,
        color=[COLOURS[5], COLOURS[1]][: len(parts)]
        if parts[0][0].startswith("ended")
        else [COLOURS[1]],
        label=[f"{name}: {int(chosen.sum())}" for name, chosen in parts],
        edgecolor="white",
        linewidth=0.4,
    )
    mean = float(used.mean())
    ax.axvline(mean, color=COLOURS[6], linestyle="--", linewidth=1.2, label=f"mean {mean:.4g}")
    whole_numbers(ax.xaxis)
    whole_numbers(ax.yaxis)
    legend_below(ax, 3)
    return ax


def pictures(data: CampaignData) -> Iterator[Picture]:
    """Yield the picture of a campaign, if a string is judged."""
    used = data.result_rows()["samples_used"]
    if not len(used):
        return

    def draw(figure: "matplotlib.figure.Figure") -> None:
        draw_counts(figure.subplots(), used, data.result_rows()["hit_maximum"] == 1)

    spare = int((data.all_sample_rows()["sample"] < data.fresh_from).sum() - used.sum())
    yield Picture(
        "samples_per_string",
        f"Samples that the strings were judged by; {max(0, spare)} more were simulated ahead of a "
        "decision and not needed. The papers took 125 [A] and 11.84 [B] on average.",
        draw,
    )
