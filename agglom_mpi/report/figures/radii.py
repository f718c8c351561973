"""Final radii of the particles of the best string ([A] fig. 5)."""

from typing import Any, Final

import numpy as np

from agglom_mpi.analysis.ranking import judged_string
from agglom_mpi.formatting import pluralise
from agglom_mpi.report.drawing import histogram_range
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.report.sample_particles import RadiusDistribution, final_radii
from agglom_mpi.report.style import COLOURS
from agglom_mpi.storage.reader import CampaignData

BINS: Final = 36


def draw_radii(ax: Any, radii: RadiusDistribution) -> Any:
    """Draw histograms of final radii by number and by mass, and return the axes."""
    ax.set_ylabel("samples (%)" if radii.of_means else "share of the particles (%)")
    mean = "mean of a sample, " if radii.of_means else ""
    ax.set_xlabel(f"final radius b/b⁰, {mean}string {radii.string}")
    values, shown = radii.values, histogram_range(radii.values)
    number = np.full(len(values), 100.0 / len(values))
    name = "" if radii.of_means else "by number"
    bars = {"color": COLOURS[5], "edgecolor": "white", "linewidth": 0.4}
    ax.hist(values, BINS, range=shown, weights=number, label=name or None, **bars)
    if not radii.of_means:
        # All grains are of one density, so that the mass of a particle is as its volume.
        mass = 100.0 * values**3 / np.sum(values**3)
        line = {"histtype": "step", "color": COLOURS[2], "linewidth": 1.4}
        ax.hist(values, BINS, range=shown, weights=mass, label="by mass", **line)
    ax.axvline(radii.mean, color=COLOURS[6], linestyle="--", linewidth=1.3, label="mean")
    if radii.target is not None:
        ax.axvline(radii.target, color=COLOURS[1], linewidth=1.3, label="asked for")
    ax.set_title(radii.moments_text)
    ax.legend()
    return ax


def _radii_data(data: CampaignData, options: FigureOptions) -> RadiusDistribution | None:
    string = judged_string(data, options.string)
    return None if string is None else final_radii(data, string, options.seconds)


def _radii_caption(radii: RadiusDistribution) -> str:
    subject = "Mean final radii" if radii.of_means else "Final radii of the particles"
    weights = "" if radii.of_means else " By mass, each particle counts as its mass."
    return (
        f"{subject} over those of the start, {pluralise(radii.samples, 'sample')} of string "
        f"{radii.string} ([A] fig. 5): {radii.source}. The mean is that over samples, the other "
        f"moments are central ones over the particles of all samples.{weights}"
    )


Figure(
    "radii",
    "particles",
    0,
    _radii_data,
    draw_radii,
    _radii_caption,
    empty="no completed sample yet",
    method="plot_radii",
    meaning="Draw how the final radii of a string are distributed ([A] fig. 5); "
    "simulated again for a second at most if they are not stored.",
    takes=("string", "ax"),
)
