"""How growth and the published objective change with the control volume and the end time."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.report import (
    TIME,
    TIME_COLUMN,
    Curve,
    ReportSection,
    Sentences,
    draw_curves,
    frame_table,
    mean_column,
)
from agglom_mpi.accuracy.soundness import summary
from agglom_mpi.accuracy.study import Rows, Setup, StudyPart, completed
from agglom_mpi.accuracy.time_integration.steps import EVENT, StudiedScene, event_engine
from agglom_mpi.analysis.extrapolation import Extrapolation, extrapolated
from agglom_mpi.analysis.finite_size import enough_grains
from agglom_mpi.display.table import Column
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.report.style import PAGE
from agglom_mpi.statistics import MeanEstimate

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

FACTORS: Final = (0.125, 0.25, 0.5, 2.0, 4.0, 8.0)
"""Numbers of particles and end times to compare, over the scene's own."""
QUICK_FACTORS: Final = (0.5, 2.0)
FEWEST_PARTICLES: Final = 8
"""Smaller numbers of particles are left out."""
LIMIT_SIZES: Final = 3
"""Number of the largest numbers of particles whose means are extrapolated in 1/N."""
WIDE: Final = (PAGE, 2.6)
"""Width and height of the figure with three panels, inches."""


def compared_numbers(scene: StudiedScene) -> dict[int, str]:
    """Return the set-ups of the numbers of particles to compare with the scene's own, ascending."""
    own = scene.campaign.scene.particles
    wanted = {round(own * factor) for factor in (QUICK_FACTORS if scene.quick else FACTORS)}
    return {n: f"{n} particles" for n in sorted(wanted) if n >= FEWEST_PARTICLES and n != own}


def compared_times(scene: StudiedScene) -> dict[float, str]:
    """Return the set-ups of the end times to compare, over the scene's own, ascending."""
    return {f: f"{f:g} × end time" for f in (QUICK_FACTORS if scene.quick else FACTORS)}


def control_volume_part(scene: StudiedScene) -> StudyPart:
    """Return the part on number of particles and end time.

    With another number of particles the box is as much larger, so that grains, volume fraction and
    end time stay what they are, and only the control volume changes.
    """
    engine, own = event_engine(scene.campaign), scene.campaign.scene
    end_time = scene.end_time
    setups: dict[str, Setup] = {}
    for number, name in compared_numbers(scene).items():
        changes: dict[str, object] = {"particles": number, "end_time": end_time}
        if own.half_width is not None:  # it follows from the size of the grains otherwise
            changes["half_width"] = own.half_width * (number / own.particles) ** (1.0 / 3.0)
        setups[name] = scene.setup(None, engine=engine, **changes)
    for factor, name in compared_times(scene).items():
        setups[name] = scene.setup(None, engine=engine, end_time=factor * end_time)
    return StudyPart(setups, lambda samples: _section(scene, samples))


def _section(scene: StudiedScene, samples: Mapping[str, Rows]) -> ReportSection:
    sizes, times = measured_volumes(scene, samples)
    own, limit = scene.campaign.scene.particles, limit_of(sizes)
    sentences = Sentences(
        "control_volume",
        particles=own,
        end_time=scene.end_time,
        size=_finite_size(sizes, own, limit),
        failed=[
            row for frame in (sizes, times) for _, row in frame[frame["failed"] > 0].iterrows()
        ],
    )
    figures = [
        Drawing(
            "box_particles",
            "Mean growth against the number of particles, with 95 % bands.",
            lambda figure: _draw(figure, sizes, "particles", "number of particles N"),
        ),
        Drawing(
            "box_finite_size",
            "Bias of mean growth against the limit of many grains with 95 % bands, standard "
            "deviation of one sample, and processor time × variance of a sample over that of "
            "the scene's own N: the cost of one standard error.",
            lambda figure: _draw_finite_size(figure, sizes, own, limit),
            WIDE,
        ),
        Drawing(
            "box_end_time",
            "Mean growth against the end time, with 95 % bands.",
            lambda figure: _draw(figure, times, "end time (s)", "end time T (s)"),
        ),
    ]
    tables = [
        frame_table(sizes, "One row is one number of particles.", "box_particles", BOX_COLUMNS),
        frame_table(times, "One row is one end time.", "box_end_time", BOX_COLUMNS),
    ]
    return sentences.section("Control volume and end time", figures, tables)


def measured_volumes(
    scene: StudiedScene, samples: Mapping[str, Rows]
) -> "tuple[pd.DataFrame, pd.DataFrame]":
    """Return growth, objective and cost against N, and against T, of the samples of all set-ups."""
    import pandas as pd

    own, end_time = scene.campaign.scene.particles, scene.end_time
    by_size = sorted({**compared_numbers(scene), own: EVENT}.items())
    by_time = sorted({**compared_times(scene), 1.0: EVENT}.items())
    sizes = [_row(scene, number, end_time, samples[name]) for number, name in by_size]
    times = [_row(scene, own, factor * end_time, samples[name]) for factor, name in by_time]
    return pd.DataFrame(sizes), pd.DataFrame(times)


def _row(scene: StudiedScene, particles: int, end_time: float, rows: Rows) -> dict[str, Any]:
    good = completed(rows)
    ratios = good["mean_radius_ratio"]
    grains = particles * scene.campaign.scene.third_moment
    value, error = scene.campaign.objective.of_grains(grains).of_rows(good)
    return {
        "particles": particles,
        "end time (s)": end_time,
        **summary(rows),
        "spread of samples": float(np.std(ratios, ddof=1)) if len(ratios) > 1 else np.nan,
        "objective": value,
        "standard error of the objective": error,
    }


def limit_of(sizes: "pd.DataFrame") -> Extrapolation:
    """Return the mean growth of the largest boxes extrapolated to many grains."""
    largest = sizes.sort_values("particles").tail(LIMIT_SIZES)
    means = [
        MeanEstimate(row["mean b/b0"], row["standard error"], int(row["samples"] - row["failed"]))
        for _, row in largest.iterrows()
    ]
    return extrapolated(largest["particles"].tolist(), means)


def _cost_of_error(sizes: "pd.DataFrame", own: int) -> NDArray[np.float64]:
    """Return processor time × variance of a sample, over that of the scene's own box, (n,)."""
    cost = (sizes[TIME] * sizes["spread of samples"] ** 2).to_numpy()
    return np.asarray(cost / cost[(sizes["particles"] == own).to_numpy()])


def _finite_size(sizes: "pd.DataFrame", own: int, limit: Extrapolation) -> dict[str, Any]:
    """Return what is concluded of the finite size of the scene's own box."""
    home = sizes[sizes["particles"] == own].iloc[0]
    error, found = home["standard error"], limit.limit
    away = home["mean b/b0"] - found.value
    bias = found._replace(value=away, error=float(np.hypot(error, found.error)))
    cost = _cost_of_error(sizes, own)
    resolved = bias.is_resolved and abs(bias.value) > error
    return {
        "limit": found.text,
        "curvature": limit.curvature.text,
        "bias": bias.text,
        "error": error,
        "resolved": resolved,
        "enough": enough_grains(own, limit._replace(shift=bias), error) if resolved else own,
        "cheapest": float(cost.min()),
        "dearest": float(cost.max()),
        "fitted": ", ".join(_plain(n) for n in sorted(sizes["particles"])[-LIMIT_SIZES:]),
    }


def _draw_finite_size(
    figure: "matplotlib.figure.Figure", sizes: "pd.DataFrame", own: int, limit: Extrapolation
) -> None:
    panels = figure.subplots(1, 3)
    grains, spread = sizes["particles"], sizes["spread of samples"]
    bias = sizes["mean b/b0"] - limit.limit.value
    panels[0].errorbar(grains, bias, yerr=sizes["half width"], fmt="o-", capsize=2, markersize=4)
    panels[0].axhline(0.0, color="0.5", linewidth=0.8)
    panels[1].plot(grains, spread, "o-", markersize=4)
    panels[1].set_yscale("log")
    panels[2].plot(grains, _cost_of_error(sizes, own), "o-", markersize=4)
    panels[2].set_ylim(bottom=0.0)
    labels = ("mean b/b⁰ less its limit", "standard deviation of b/b⁰", "time × variance, relative")
    for axes, label in zip(panels, labels, strict=True):
        axes.set_xscale("log")
        axes.set_xlabel("number of particles N")
        axes.set_ylabel(label)


BOX_COLUMNS: Final = (
    Column("particles", "N"),
    Column("end time (s)", "T", format=lambda time: f"{time:.3g} s"),
    Column("samples"),
    mean_column("mean b/b⁰", "mean b/b0", "standard error", "samples"),
    Column("spread of samples", "spread of one sample", format=".2g"),
    mean_column("objective", "objective", "standard error of the objective", "samples"),
    TIME_COLUMN,
)


def _draw(
    figure: "matplotlib.figure.Figure", frame: "pd.DataFrame", column: str, label: str
) -> None:
    mean, half = frame["mean b/b0"], frame["half width"]
    curve = Curve("mean b/b⁰", frame[column], mean, mean - half, mean + half)
    axes = draw_curves(figure, [curve], label, "mean b/b⁰", scales=("log", "linear"))
    axes.set_xticks(list(frame[column]), [_plain(value) for value in frame[column]])
    axes.minorticks_off()


def _plain(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
