"""Final radii of the particles of the best string ([A] fig. 5)."""

from typing import Any, Final

import numpy as np

from agglom_mpi.analysis.ranking import judged_string
from agglom_mpi.formatting import pluralise
from agglom_mpi.report.drawing import COLOURS, histogram_range, style_axes
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.report.sample_particles import RadiusDistribution, final_radii
from agglom_mpi.storage.reader import CampaignData

BINS: Final = 36


def draw_radii(ax: Any, radii: RadiusDistribution) -> Any:
    """Draw a histogram of final radii with their moments, and return the axes."""
    style_axes(ax)
    ax.set_ylabel("samples (%)" if radii.of_means else "particles (%)")
    mean = "mean of a sample, " if radii.of_means else ""
    ax.set_xlabel(f"final radius b/b0, {mean}string {radii.string} (1)")
    ax.hist(
        radii.values,
        bins=BINS,
        range=histogram_range(radii.values),
        weights=np.full(len(radii.values), 100.0 / len(radii.values)),
        color=COLOURS[5],
        edgecolor="white",
        linewidth=0.4,
    )
    ax.axvline(radii.mean, color=COLOURS[6], linestyle="--", linewidth=1.3, label="mean")
    if radii.target is not None:
        ax.axvline(radii.target, color=COLOURS[1], linewidth=1.3, label="asked for")
    ax.set_title(radii.moments_text, fontsize="medium")
    ax.legend(frameon=False, fontsize="small")
    return ax


def _radii_data(data: CampaignData, options: FigureOptions) -> RadiusDistribution | None:
    string = judged_string(data, options.string)
    return None if string is None else final_radii(data, string, options.seconds)


def _radii_caption(radii: RadiusDistribution) -> str:
    subject = "Mean final radii" if radii.of_means else "Final radii of the particles"
    return (
        f"{subject} over those of the start, {pluralise(radii.samples, 'sample')} of string "
        f"{radii.string} ([A] fig. 5): {radii.source}. The mean is that over samples, the other "
        "moments are central ones over the particles of all samples."
    )


RADII: Final = Figure(
    "radii",
    "particles",
    _radii_data,
    draw_radii,
    _radii_caption,
    empty="no completed sample yet",
)
