"""Number and size of the particles of one run, granular temperature and temperature over time."""

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.physics.rough import INERTIA
from agglom_mpi.report.style import COLOURS, MIDDLE, panels
from agglom_mpi.simulation.boundary import Boundary
from agglom_mpi.simulation.frames import Frames

if TYPE_CHECKING:
    import matplotlib.figure

Floats = NDArray[np.float64]

MAX_MARKED: Final = 40
"""Maximum number of frames that are marked one by one: between them nothing is known."""
LOGARITHMIC_RATIO: Final = 15.0
"""Ratio of the largest to the smallest granular temperature above which its axis is logarithmic."""
PANEL_HEIGHT: Final = 1.3
"""Height of a panel, inches."""


Evolution = dict[str, NDArray[Any]]
"""Averages over the particles of one run by name, at F `times` in s, arrays of shape (F,).

- `particles`: their number; `mean_radius_ratio`: mean of b/b⁰ over them
- `granular_temperature`: a third of the mean squared velocity about that of the mean flow, by mass:
  Σ m|v − V|²/(3 Σ m), m²/s²; 0 of a single one
- `rotational_temperature`, where grains spin: Σ (2/5)mr²ω²/(3 Σ m), m²/s²
- `mean_temperature`: by mass, K
"""

AXIS_LABELS: Final = {
    "particles": "particles",
    "mean_radius_ratio": "mean radius\nb/b⁰",
    "granular_temperature": "granular\ntemperature\n(m²/s²)",
    "rotational_temperature": "rotational\ntemperature\n(m²/s²)",
    "mean_temperature": "mean\ntemperature\n(K)",
}


KINETIC: Final = ("granular_temperature", "rotational_temperature")
"""Quantities whose axis may be logarithmic."""


def evolution(frames: Frames, box: Boundary | None = None) -> Evolution:
    """Return averages over the particles of frames, the first of which shows the grains.

    Their own mean radius is b⁰, which that of the law of sizes is within its scatter. The mean flow
    of the `box` is no motion.
    """
    present = frames.grains > 0
    mass = np.where(present, frames.masses, 0.0)
    total = mass.sum(axis=1)
    velocity = np.where(present[..., None], frames.velocities, 0.0)
    if box is not None and box.is_sheared():
        heights = np.where(present, frames.positions[..., 1], 0.0)
        velocity[..., 0] -= box.flow_speed(1.0) * heights
    flow = np.einsum("fn,fnk->fk", mass, velocity) / total[:, None]
    square = np.sum((velocity - flow[:, None]) ** 2, axis=2)
    square[frames.particles == 1] = 0.0  # but for rounding
    first = frames.radii[0]
    equal = np.nanmin(first) == np.nanmax(first)
    mean_radius = first[0] if equal else np.nanmean(first)
    rotation: Evolution = {}
    if frames.spins is not None:
        spun = np.where(present[..., None], frames.spins * frames.radii[..., None], 0.0)
        rotational = INERTIA * np.sum(mass * np.sum(spun**2, axis=2), axis=1) / (3.0 * total)
        rotation = {"rotational_temperature": rotational}
    heat = mass * np.where(present, frames.temperatures, 0.0)
    return rotation | {
        "times": frames.times,
        "particles": frames.particles,
        "mean_radius_ratio": np.nanmean(frames.radii, axis=1) / mean_radius,
        "granular_temperature": np.sum(mass * square, axis=1) / (3.0 * total),
        "mean_temperature": heat.sum(axis=1) / total,
    }


def shown_quantities(run: Evolution) -> list[str]:
    """Return the quantities to show: the temperature only if it changes by more than rounding."""
    temperature = run["mean_temperature"]
    changes = np.ptp(temperature) > 1e-9 * temperature.max()
    return [name for name in AXIS_LABELS if name in run and (changes or name != "mean_temperature")]


def evolution_size(run: Evolution) -> tuple[float, float]:
    """Return width and height in inches of the figure of a run."""
    return MIDDLE, PANEL_HEIGHT * len(shown_quantities(run)) + 0.5


def draw_evolution(figure: "matplotlib.figure.Figure", run: Evolution) -> Any:
    """Draw averages over a run against time, one panel below the other.

    Parameters
    ----------
    figure
        An empty figure; `evolution_size` suits it.
    run

    Returns
    -------
    numpy.ndarray
        The axes, one for each of `shown_quantities`.
    """
    names = shown_quantities(run)
    factor, unit = _time_unit(run["times"][-1])
    axes = panels(figure, len(names), 1, f"time ({unit})")
    mark = "o" if len(run["times"]) <= MAX_MARKED else None
    for ax, name, colour in zip(axes, names, COLOURS, strict=False):
        values = run[name]
        ax.plot(
            run["times"] / factor, values, color=colour, marker=mark, markersize=4, clip_on=False
        )
        ax.set_ylabel(AXIS_LABELS[name])
        _scale(ax, name, values)
    figure.align_ylabels(axes)
    return axes


def _scale(ax: Any, name: str, values: Floats) -> None:
    from matplotlib.ticker import MaxNLocator

    positive = values[values > 0.0]
    wide = len(positive) and positive.max() > LOGARITHMIC_RATIO * positive.min()
    if name in KINETIC and wide:
        ax.set_yscale("log")
        return
    ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10], integer=name == "particles"))
    if name in ("particles", *KINETIC):
        ax.set_ylim(bottom=0.0)


def _time_unit(last: float) -> tuple[float, str]:
    """Return the factor and the name of the multiple of a second that suits times up to `last`."""
    from matplotlib.ticker import EngFormatter

    power = int(np.clip(3 * np.floor(np.log10(last) / 3), -24, 0)) if last > 0.0 else 0
    return 10.0**power, f"{EngFormatter.ENG_PREFIXES[power]}s"
