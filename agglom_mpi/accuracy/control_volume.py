"""How growth and the published objective change with the control volume and the end time."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.document import (
    Curve,
    ReportSection,
    ReportTable,
    Sentences,
    TableColumn,
    draw_curves,
)
from agglom_mpi.accuracy.run_times import shown_time, time_columns, time_name
from agglom_mpi.accuracy.study import Rows, Setup, completed, with_scene
from agglom_mpi.accuracy.time_integration import EVENT, end_time_of, event_engine
from agglom_mpi.analysis.extrapolation import Extrapolation, extrapolated
from agglom_mpi.analysis.finite_size import enough_grains
from agglom_mpi.analysis.tables import time_on_free_core
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.statistics import MeanEstimate, mean_of

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

SIZES: Final = (0.125, 0.25, 0.5, 2.0, 4.0, 8.0)
"""Numbers of particles to compare, over the scene's own."""
QUICK_SIZES: Final = (0.5, 2.0)
TIMES: Final = (0.125, 0.25, 0.5, 2.0, 4.0, 8.0)
"""End times to compare, over the scene's own."""
QUICK_TIMES: Final = (0.5, 2.0)
FEWEST_PARTICLES: Final = 8
"""Smaller numbers of particles are left out."""


def numbers(campaign: Campaign, quick: bool) -> list[int]:
    """Return the numbers of particles to compare with the scene's own, ascending."""
    own = campaign.scene.particles
    wanted = {round(own * factor) for factor in (QUICK_SIZES if quick else SIZES)}
    return sorted(number for number in wanted if number >= FEWEST_PARTICLES and number != own)


def name_of_number(number: int) -> str:
    """Return the name of the set-up with `number` particles."""
    return f"{number} particles"


def name_of_time(factor: float) -> str:
    """Return the name of the set-up whose end time is `factor` times the scene's."""
    return f"{factor:g} × end time"


def setups(
    campaign: Campaign, parameters: NDArray[np.float64], samples: int, quick: bool
) -> dict[str, Setup]:
    """Return the set-ups of the section, by name.

    With another number of particles the box is as much larger, so that grains, volume fraction and
    end time stay what they are, and only the control volume changes.
    """
    engine, scene = event_engine(campaign), campaign.scene
    end_time = end_time_of(campaign, parameters)
    chosen = {}
    for number in numbers(campaign, quick):
        changes: dict[str, object] = {"particles": number, "end_time": end_time, "engine": engine}
        if scene.half_width is not None:  # it follows from the size of the grains otherwise
            changes["half_width"] = scene.half_width * (number / scene.particles) ** (1.0 / 3.0)
        larger = with_scene(campaign, **changes)
        chosen[name_of_number(number)] = Setup(larger, parameters, samples)
    for factor in QUICK_TIMES if quick else TIMES:
        longer = with_scene(campaign, end_time=factor * end_time, engine=engine)
        chosen[name_of_time(factor)] = Setup(longer, parameters, samples)
    return chosen


def control_volume_section(
    campaign: Campaign,
    parameters: NDArray[np.float64],
    samples: Mapping[str, Rows],
    quick: bool,
) -> ReportSection:
    """Return the section on number of particles and end time; arguments as for `measure`."""
    sizes, times = measure(campaign, parameters, samples, quick)
    own = campaign.scene.particles
    limit = limit_of(sizes)
    end_time = end_time_of(campaign, parameters)
    sentences = Sentences(
        "control_volume",
        particles=own,
        end_time=end_time,
        size=_finite_size(sizes, own, limit),
        failed=[
            row for frame in (sizes, times) for _, row in frame[frame["failed"] > 0].iterrows()
        ],
    )
    return sentences.section(
        title="Control volume and end time",
        figures=(
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
        ),
        tables=(
            ReportTable("box_particles", "One row is one number of particles.", sizes, COLUMNS),
            ReportTable("box_end_time", "One row is one end time.", times, COLUMNS),
        ),
    )


def measure(
    campaign: Campaign,
    parameters: NDArray[np.float64],
    samples: Mapping[str, Rows],
    quick: bool,
) -> "tuple[pd.DataFrame, pd.DataFrame]":
    """Return growth, objective and cost against N, and against T: two frames.

    Parameters
    ----------
    campaign, parameters
        The scene and the string, shape (k,), SI units.
    samples
        Rows of each of `setups`, and of the event engine.
    quick
        Whether the quick set-ups ran.
    """
    import pandas as pd

    own, end_time = campaign.scene.particles, end_time_of(campaign, parameters)
    by_size = {number: name_of_number(number) for number in numbers(campaign, quick)} | {own: EVENT}
    by_time = {f: name_of_time(f) for f in (QUICK_TIMES if quick else TIMES)} | {1.0: EVENT}
    sizes = [
        _row(campaign, number, end_time, samples[name]) for number, name in sorted(by_size.items())
    ]
    times = [
        _row(campaign, own, factor * end_time, samples[name])
        for factor, name in sorted(by_time.items())
    ]
    return pd.DataFrame(sizes), pd.DataFrame(times)


def _row(campaign: Campaign, particles: int, end_time: float, rows: Rows) -> dict[str, float]:
    good = completed(rows)
    ratios = good["mean_radius_ratio"]
    growth = mean_of(ratios)
    grains = particles * campaign.scene.third_moment
    value, error = campaign.objective.of_grains(grains).of_rows(good)
    return {
        "particles": particles,
        "end time (s)": end_time,
        "samples": len(rows),
        "failed": len(rows) - len(good),
        "mean b/b0": growth.value,
        "standard error": growth.error,
        "half width": growth.half_width,
        "spread of samples": float(np.std(ratios, ddof=1)) if len(ratios) > 1 else np.nan,
        "objective": value,
        "standard error of the objective": error,
        **time_columns("sample", time_on_free_core(rows)),
    }


LIMIT_SIZES: Final = 3
"""Number of the largest numbers of particles whose means are extrapolated in 1/N."""
WIDE: Final = (11.0, 3.6)
"""Width and height of the figure with three panels, inches."""


def limit_of(sizes: "pd.DataFrame") -> Extrapolation:
    """Return the mean growth of the largest boxes extrapolated to many grains."""
    largest = sizes.sort_values("particles").tail(LIMIT_SIZES).sort_values("particles")
    means = [
        MeanEstimate(row["mean b/b0"], row["standard error"], int(row["samples"] - row["failed"]))
        for _, row in largest.iterrows()
    ]
    return extrapolated(largest["particles"].tolist(), means)


def _cost_of_error(sizes: "pd.DataFrame", own: int) -> NDArray[np.float64]:
    """Return processor time × variance of a sample, over that of the scene's own box, (n,)."""
    cost = (sizes[time_name("sample")] * sizes["spread of samples"] ** 2).to_numpy()
    return np.asarray(cost / cost[(sizes["particles"] == own).to_numpy()])


def _finite_size(sizes: "pd.DataFrame", own: int, limit: Extrapolation) -> dict[str, Any]:
    """Return what is concluded of the finite size of the scene's own box."""
    home = sizes[sizes["particles"] == own].iloc[0]
    error = home["standard error"]
    found = limit.limit
    away = home["mean b/b0"] - found.value
    bias = found._replace(value=away, error=float(np.hypot(error, found.error)))
    scaled = limit._replace(shift=bias)
    cost = _cost_of_error(sizes, own)
    resolved = bias.is_resolved and abs(bias.value) > error
    return {
        "limit": found.text,
        "curvature": limit.curvature.text,
        "bias": bias.text,
        "error": error,
        "resolved": resolved,
        "enough": enough_grains(own, scaled, error) if resolved else own,
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
        axes.grid(True, which="major", color="0.9", linewidth=0.6)


COLUMNS: Final = (
    TableColumn.number("particles", ".0f", "N"),
    TableColumn("T", lambda row: f"{row['end time (s)']:.3g} s"),
    TableColumn.number("samples", ".0f"),
    TableColumn.mean("mean b/b⁰", "mean b/b0", "standard error", "samples"),
    TableColumn.number("spread of samples", ".2g", "spread of one sample"),
    TableColumn.mean("objective", "objective", "standard error of the objective", "samples"),
    shown_time("sample"),
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
