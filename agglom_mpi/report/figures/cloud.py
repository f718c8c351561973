"""The cloud of particles at successive times ([B] fig. 5).

The box is seen obliquely from far away: then every sphere is a circle of its own radius, to scale.
"""

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.formatting import value_with_prefix

if TYPE_CHECKING:
    import matplotlib.figure

Floats = NDArray[np.float64]

COLUMNS: Final = 3
"""Panels in a row."""
PANEL: Final = 2.8
"""Inches of a panel, wide and high."""
COLOUR_MAP: Final = "viridis"
MANY: Final = 5000
"""Particles beyond which an SVG holds pixels instead of circles."""


def cloud_size(frames: int) -> tuple[float, float]:
    """Width and height in inches of the figure of so many frames."""
    columns = min(frames, COLUMNS)
    return PANEL * columns + 0.9, PANEL * -(-frames // COLUMNS) + 0.3


def draw_cloud(
    figure: "matplotlib.figure.Figure",
    times: Sequence[float] | Floats,
    positions: Sequence[Floats],
    radii: Sequence[Floats],
    half_width: float,
    temperature: Sequence[Floats] | None = None,
) -> Any:
    """Draw the particles at F times, one panel each, to scale  [B fig. 5].

    Parameters
    ----------
    figure
        An empty figure; `cloud_size(F)` suits it.
    times
        Shape (F,), s.
    positions
        Centres in the box, F arrays of shape (n, 3), m.
    radii
        F arrays of shape (n,), m.
    half_width
        D of the box from −D to D, m.
    temperature
        F arrays of shape (n,), K. It colours the particles; without it, or where nothing changes
        it, their size does.

    Returns
    -------
    numpy.ndarray
        The F axes, shape (F,).
    """
    from matplotlib.cm import ScalarMappable

    columns = min(len(times), COLUMNS)
    rows = -(-len(times) // columns)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for unused in grid[len(times) :]:
        unused.remove()
    axes = grid[: len(times)]
    colour = _colour(radii, temperature)
    norm = _norm(colour.values)
    reach = _reach(half_width, positions, radii)
    for ax, time, place, radius, value in zip(
        axes, times, positions, radii, colour.values, strict=True
    ):
        _draw_box(ax, half_width, reach)
        _draw_spheres(ax, place, radius, value, norm)
        ax.set_title(
            f"t = {value_with_prefix(float(time), 's')}, {len(radius)} particles", fontsize=9
        )
    _label_side(axes[0], half_width)
    scale = ScalarMappable(norm, COLOUR_MAP)
    figure.colorbar(scale, ax=list(axes), label=colour.label, shrink=0.85 / rows, pad=0.02)
    return axes


class _Colour(NamedTuple):
    """What colours the particles of each frame."""

    label: str
    values: list[Floats]


def _colour(radii: Sequence[Floats], temperature: Sequence[Floats] | None) -> _Colour:
    if temperature is not None:
        heat = [np.asarray(values, float) for values in temperature]
        low, high = _range(heat)
        if high - low > 1e-9 * abs(high):
            return _Colour("temperature (K)", heat)
    grain = _range([np.asarray(radii[0], float)])[0]
    return _Colour("radius / smallest at first", [np.asarray(r, float) / grain for r in radii])


def _range(values: Sequence[Floats]) -> tuple[float, float]:
    """Smallest and largest of all values; 1 and 1 if there are none."""
    known = [part for part in values if len(part)]
    if not known:
        return 1.0, 1.0
    return min(float(part.min()) for part in known), max(float(part.max()) for part in known)


def _norm(values: Sequence[Floats]) -> Any:
    from matplotlib.colors import Normalize

    low, high = _range(values)
    return Normalize(low, high if high > low else low + max(1e-3 * abs(low), 1e-3))


def _view() -> Floats:
    """Return unit vectors to the right, up and towards the eye, as rows of a (3, 3) matrix."""
    around, above = np.radians(-62.0), np.radians(22.0)
    right = np.array([-np.sin(around), np.cos(around), 0.0])
    eye = np.array([np.cos(above) * np.cos(around), np.cos(above) * np.sin(around), np.sin(above)])
    return np.array([right, np.cross(eye, right), eye])


def _corners(half_width: float) -> Floats:
    return half_width * np.array(list(product((-1.0, 1.0), repeat=3)))


def _reach(half_width: float, positions: Sequence[Floats], radii: Sequence[Floats]) -> Floats:
    """How far the box, and spheres that stick out of it, reach to the side and up, shape (2,).

    And a little farther, so that no line is cut off.
    """
    view = _view()[:2].T
    reach = np.abs(_corners(half_width) @ view).max(axis=0)
    for place, radius in zip(positions, radii, strict=True):
        ends = np.abs(np.asarray(place, float).reshape(-1, 3) @ view)
        ends += np.asarray(radius, float)[:, None]
        reach = np.maximum(reach, ends.max(axis=0, initial=0.0))
    return 1.03 * reach


def _draw_box(ax: Any, half_width: float, reach: Floats) -> None:
    """Draw the twelve edges, those that the corner nearest to the eye ends in above all else."""
    view, corners = _view(), _corners(half_width)
    nearest = int(np.argmax(corners @ view[2]))
    for i, j in product(range(8), repeat=2):
        if i < j and np.sum(corners[i] != corners[j]) == 1:
            x, y = (corners[[i, j]] @ view[:2].T).T
            front = nearest in (i, j)
            ax.plot(x, y, color="0.45", linewidth=0.7, zorder=3 if front else 1)
    ax.set_xlim(-reach[0], reach[0])
    ax.set_ylim(-reach[1], reach[1])
    ax.set_aspect("equal")
    ax.set_axis_off()


def _label_side(ax: Any, half_width: float) -> None:
    """Write how long the side is, along the lowest edge at the left and below all spheres."""
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
        fontsize=8,
        color="0.3",
        zorder=4,
    )


def _draw_spheres(ax: Any, place: Floats, radius: Floats, value: Floats, norm: Any) -> None:
    """Draw spheres as circles of their radius, the far ones first."""
    from matplotlib.collections import EllipseCollection

    view = _view()
    seen = np.asarray(place, float).reshape(-1, 3) @ view.T
    order = np.argsort(seen[:, 2], kind="stable")
    width = 2.0 * np.asarray(radius, float)[order]
    spheres = EllipseCollection(
        width,
        width,
        np.zeros(len(order)),
        units="xy",
        offsets=seen[order, :2],
        offset_transform=ax.transData,
        array=np.asarray(value, float)[order],
        norm=norm,
        cmap=COLOUR_MAP,
        edgecolors="0.15",
        linewidths=0.25,
        zorder=2,
        rasterized=len(order) > MANY,
    )
    ax.add_collection(spheres, autolim=False)
