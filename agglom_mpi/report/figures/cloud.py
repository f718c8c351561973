"""Particles of a string: in their box at successive times, and their final radii.

The box is seen obliquely from far away: then every sphere is a circle of its own radius, to scale.
"""

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.ranking import judged_string
from agglom_mpi.formatting import pluralise, value_with_prefix
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.report.sample_particles import (
    FramesUnavailableError,
    RadiusDistribution,
    SampleFrames,
    final_radii,
    frames_of,
    informative_frames,
)
from agglom_mpi.report.style import COLOURS, POINT_MAP, histogram_range, panels
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import matplotlib.figure


Floats = NDArray[np.float64]

COLUMNS: Final = 3
"""Panels in a row."""
PANEL: Final = 2.15
"""Width and height of a panel, inches."""
MAX_CIRCLES: Final = 5000
"""Particles beyond which an SVG holds pixels instead of circles."""
DIRECTION: Final = (-62.0, 22.0)
"""Azimuth and elevation of the eye, degrees."""
MARGIN: Final = 1.03
"""Width of the axes over that of the box, so that no line is cut off."""


def cloud_size(frames: int) -> tuple[float, float]:
    """Return width and height in inches of a figure with one panel per frame."""
    columns = min(frames, COLUMNS)
    return PANEL * columns + 0.9, PANEL * -(-frames // COLUMNS) + 0.3


def draw_frames(
    figure: "matplotlib.figure.Figure", frames: Frames, shown: Sequence[int], half_width: float
) -> Any:
    """Draw some frames of a sample, one panel each, to scale  [B fig. 5], and return the axes.

    Particles are coloured by temperature, or where nothing changes it, by size.

    Parameters
    ----------
    figure
        An empty figure; `cloud_size(len(shown))` suits it.
    frames
    shown
        Indices of the frames to draw.
    half_width
        D of the box from −D to D, m.

    Returns
    -------
    numpy.ndarray
        Shape (len(shown),).
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    axes, rows = panels(figure, len(shown), COLUMNS), -(-len(shown) // COLUMNS)
    filled = [(f, slice(frames.particles[f])) for f in shown]
    positions, radii, temperatures = (
        [np.asarray(values[at], float) for at in filled]
        for values in (frames.positions, frames.radii, frames.temperatures)
    )
    label, values = _colouring(radii, temperatures)
    low, high = _range(values)
    norm = Normalize(low, high if high > low else low + max(1e-3 * abs(low), 1e-3))
    extent = _extent(half_width, positions, radii)
    for place, (ax, f) in enumerate(zip(axes, shown, strict=True)):
        _draw_box(ax, half_width, extent)
        _draw_spheres(ax, positions[place], radii[place], values[place], norm)
        time = value_with_prefix(float(frames.times[f]), "s")
        ax.set_title(f"t = {time}, {pluralise(len(radii[place]), 'particle')}")
    _label_side(axes[0], half_width)
    scale = ScalarMappable(norm, POINT_MAP)
    figure.colorbar(scale, ax=list(axes), label=label, shrink=0.85 / rows, pad=0.02)
    return axes


def _colouring(
    radii: Sequence[Floats], temperatures: Sequence[Floats]
) -> tuple[str, Sequence[Floats]]:
    """Return what colours the particles of each frame, and its name with the unit.

    It is the temperatures, or the radii where temperatures are all the same.
    """
    low, high = _range(temperatures)
    if high - low > 1e-9 * abs(high):
        return "temperature (K)", temperatures
    grain = _range(radii[:1])[0]
    return "radius / smallest at first", [each / grain for each in radii]


def _range(values: Sequence[Floats]) -> tuple[float, float]:
    """Return the smallest and the largest of all values; 1 and 1 if there are none."""
    known = [part for part in values if len(part)]
    if not known:
        return 1.0, 1.0
    return min(float(part.min()) for part in known), max(float(part.max()) for part in known)


def _view() -> Floats:
    """Return unit vectors to the right, up and towards the eye, as rows of a (3, 3) matrix."""
    azimuth, elevation = np.radians(DIRECTION)
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    across = np.cos(elevation)
    eye = np.array([across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)])
    return np.array([right, np.cross(eye, right), eye])


def _corners(half_width: float) -> Floats:
    return half_width * np.array(list(product((-1.0, 1.0), repeat=3)))


def _extent(half_width: float, positions: Sequence[Floats], radii: Sequence[Floats]) -> Floats:
    """Return half the width and half the height of what is seen, m, shape (2,).

    It holds the box, and spheres that stick out of it.
    """
    view = _view()[:2].T
    extent = np.abs(_corners(half_width) @ view).max(axis=0)
    for position, radius in zip(positions, radii, strict=True):
        ends = np.abs(position.reshape(-1, 3) @ view)
        ends += radius[:, None]
        extent = np.maximum(extent, ends.max(axis=0, initial=0.0))
    return MARGIN * extent


def _draw_box(ax: Any, half_width: float, extent: Floats) -> None:
    """Draw the twelve edges; the three that meet nearest to the eye cover the spheres."""
    view, corners = _view(), _corners(half_width)
    nearest = int(np.argmax(corners @ view[2]))
    for i, j in product(range(8), repeat=2):
        if i < j and np.sum(corners[i] != corners[j]) == 1:
            x, y = (corners[[i, j]] @ view[:2].T).T
            front = nearest in (i, j)
            ax.plot(x, y, color="0.45", linewidth=0.7, zorder=3 if front else 1)
    ax.set_xlim(-extent[0], extent[0])
    ax.set_ylim(-extent[1], extent[1])
    ax.set_aspect("equal")
    ax.set_axis_off()


def _label_side(ax: Any, half_width: float) -> None:
    """Write the length of the side along the lowest edge at the left, below all spheres."""
    ends = half_width * np.array([[-1.0, -1.0, -1.0], [1.0, -1.0, -1.0]])
    (x0, y0), (x1, y1) = ends @ _view()[:2].T
    slope = float(np.degrees(np.arctan2(y1 - y0, x1 - x0)))
    at = (0.5 * (x0 + x1), ax.get_ylim()[0])
    ax.text(
        *at,
        value_with_prefix(2.0 * half_width, "m"),
        ha="center",
        va="top",
        rotation=slope,
        rotation_mode="anchor",
        color="0.3",
        zorder=4,
    )


def _draw_spheres(ax: Any, position: Floats, radius: Floats, value: Floats, norm: Any) -> None:
    """Draw spheres as circles of their radius, the far ones first."""
    from matplotlib.collections import EllipseCollection

    view = _view()
    seen = position.reshape(-1, 3) @ view.T
    order = np.argsort(seen[:, 2], kind="stable")
    width = 2.0 * radius[order]
    spheres = EllipseCollection(
        width,
        width,
        np.zeros(len(order)),
        units="xy",
        offsets=seen[order, :2],
        offset_transform=ax.transData,
        array=value[order],
        norm=norm,
        cmap=POINT_MAP,
        edgecolors="0.15",
        linewidths=0.25,
        zorder=2,
        rasterized=len(order) > MAX_CIRCLES,
    )
    ax.add_collection(spheres, autolim=False)


def _cloud_data(data: CampaignData, options: FigureOptions) -> SampleFrames:
    string = judged_string(data, options.string)
    if string is None:
        raise FramesUnavailableError("no string is judged yet")
    return frames_of(data, string, options.seconds)


def _draw_sample(figure: "matplotlib.figure.Figure", sample: SampleFrames) -> Any:
    shown = informative_frames(sample.frames)
    return draw_frames(figure, sample.frames, shown, sample.half_width)


def _cloud_caption(sample: SampleFrames) -> str:
    return (
        f"Particles of sample {sample.sample} of string {sample.string} at successive times, "
        f"{sample.source} ([B] fig. 5). The box is seen obliquely, spheres are to scale."
    )


Figure(
    "cloud",
    "particles",
    1,
    _cloud_data,
    _draw_sample,
    _cloud_caption,
    lambda sample: cloud_size(len(informative_frames(sample.frames))),
    panels=True,
    method="plot_cloud",
    meaning="Draw the particles of a sample at successive times ([B] fig. 5); simulated again if "
    "they are not stored.",
    takes=("string", "figure"),
)


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
