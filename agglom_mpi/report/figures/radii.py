"""How large the particles of the best string became: their radii over all samples ([A] fig. 5)."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.report.figures.axes import grid, say
from agglom_mpi.report.picture import COLOURS, Picture

if TYPE_CHECKING:
    import matplotlib.figure

    from agglom_mpi.storage.reader import CampaignData

Floats = NDArray[np.float64]

BINS: Final = 36


def target_ratio(data: "CampaignData") -> float | None:
    """Return the mean radius ratio that a campaign asks for; None if it asks for none."""
    if data.identity.get("objective.law") != "growth_target":
        return None
    return float(data.identity["objective.ratio"])


class Radii(NamedTuple):
    """Final radii b/b0 of a string.

    Attributes
    ----------
    string
    values
        Of the particles of all samples, shape (n,); or, if `of_means`, the mean of each sample.
    samples
        How many samples they are of.
    of_means
    mean, central
        Mean over samples of their mean radius, and central moments 2, 3, 4 over the particles of
        all samples [A 24].
    source
        Where they are from, in words.
    """

    string: int
    values: Floats
    samples: int
    of_means: bool
    mean: float
    central: tuple[float, float, float]
    source: str

    @property
    def moments(self) -> str:
        """The moments in words: mean, standard deviation, skewness and kurtosis [A 29]."""
        second, third, fourth = self.central
        words = f"mean {self.mean:.3f}, standard deviation {np.sqrt(second):.3f}"
        if second <= 0.0:
            return words
        return f"{words}\nskewness {third / second**1.5:.2f}, kurtosis {fourth / second**2:.2f}"


def draw_radii(ax: Any, found: Radii | None, target: float | None = None) -> Any:
    """Draw how the radii are distributed, with their moments, and return the axes.

    Parameters
    ----------
    found
        None if there are none.
    target
        The mean ratio that is asked for.
    """
    grid(ax)
    ax.set_ylabel("samples (%)" if found is not None and found.of_means else "particles (%)")
    if found is None or not len(found.values):
        say(ax, "no completed sample yet")
        return ax
    mean = "mean of a sample, " if found.of_means else ""
    ax.set_xlabel(f"final radius b/b0, {mean}string {found.string} (1)")
    share = np.full(len(found.values), 100.0 / len(found.values))
    ax.hist(
        found.values,
        bins=BINS,
        weights=share,
        color=COLOURS[5],
        edgecolor="white",
        linewidth=0.4,
    )
    ax.axvline(found.mean, color=COLOURS[6], linestyle="--", linewidth=1.3, label="mean")
    if target is not None:
        ax.axvline(target, color=COLOURS[1], linewidth=1.3, label="asked for")
    ax.set_title(found.moments, fontsize="medium")
    ax.legend(frameon=False, fontsize="small")
    return ax


def pictures(found: Radii | None, target: float | None) -> Iterator[Picture]:
    """Yield the picture of radii, if there are any."""
    if found is None:
        return

    def draw(figure: "matplotlib.figure.Figure") -> None:
        draw_radii(figure.subplots(), found, target)

    of = "Mean final radii" if found.of_means else "Final radii of the particles"
    yield Picture(
        "radii",
        f"{of} over those of the start, {found.samples} samples of string {found.string} "
        f"([A] fig. 5): {found.source}. The mean is that over samples, the other moments are "
        "central ones over the particles of all samples.",
        draw,
    )
