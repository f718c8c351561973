"""The control volume and the end time: what the published objective makes of them."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.curves import Curve, draw_curves
from agglom_mpi.accuracy.section import Section, Shown, Table
from agglom_mpi.accuracy.statistics import completed
from agglom_mpi.accuracy.time_integration import EVENT, end_time_of, event_engine
from agglom_mpi.accuracy.trials import Trial, with_scene
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.formatting import format_digits, format_mean, format_seconds
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.statistics import MeanEstimate, mean_of

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

Rows = NDArray[np.void]

SIZES: Final = (0.125, 0.25, 0.5, 2.0, 4.0, 8.0)
"""Numbers of particles to compare, over the scene's own."""
QUICK_SIZES: Final = (0.5, 2.0)
TIMES: Final = (0.125, 0.25, 0.5, 2.0, 4.0, 8.0)
"""End times to compare, over the scene's own."""
QUICK_TIMES: Final = (0.5, 2.0)
FEWEST_PARTICLES: Final = 8


def numbers(campaign: Campaign, quick: bool) -> list[int]:
    """Numbers of particles to compare with the scene's own."""
    own = campaign.scene.particles
    wanted = {round(own * factor) for factor in (QUICK_SIZES if quick else SIZES)}
    return sorted(number for number in wanted if number >= FEWEST_PARTICLES and number != own)


def name_of_number(number: int) -> str:
    """Name of the trial with so many particles."""
    return f"{number} particles"


def name_of_time(factor: float) -> str:
    """Name of the trial that runs so many times as long."""
    return f"{factor:g} × end time"


def trials(
    campaign: Campaign, parameters: NDArray[np.float64], samples: int, quick: bool
) -> dict[str, Trial]:
    """Return the trials of the section.

    With another number of particles the box is as much larger, so that grains, volume fraction and
    end time stay what they are, and only the control volume changes.
    """
    engine, scene = event_engine(campaign), campaign.scene
    end_time = end_time_of(campaign, parameters)
    chosen = {}
    for number in numbers(campaign, quick):
        half_width = scene.half_width * (number / scene.particles) ** (1.0 / 3.0)
        larger = with_scene(
            campaign, particles=number, half_width=half_width, end_time=end_time, engine=engine
        )
        chosen[name_of_number(number)] = Trial(larger, parameters, samples)
    for factor in QUICK_TIMES if quick else TIMES:
        longer = with_scene(campaign, end_time=factor * end_time, engine=engine)
        chosen[name_of_time(factor)] = Trial(longer, parameters, samples)
    return chosen


def box(
    campaign: Campaign,
    parameters: NDArray[np.float64],
    samples: Mapping[str, Rows],
    quick: bool,
) -> Section:
    """Section on the number of particles and the end time; `samples` as for `trials`."""
    sizes, times = measure(campaign, parameters, samples, quick)
    own = campaign.scene.particles
    end_time = end_time_of(campaign, parameters)
    return Section(
        title="Control volume and end time",
        problem=(
            "[A] calls its results very sensitive to the control volume. How much of the published "
            "objective is the number of particles N that was chosen, and the time T?"
        ),
        reference=(
            f"The scene itself, N = {own} and T = {end_time:.4g} s, with the event engine. There "
            "is no right N or T: the table shows what the choice is worth."
        ),
        setups=(
            "With another N the box is larger or smaller in proportion, so grains, volume fraction "
            "and T stay the same; with another T everything else does. Samples of different N "
            "start from different configurations, so differences are not paired there."
        ),
        figures=(
            Drawing(
                "box_particles",
                "Mean growth against the number of particles, with 95 % bands.",
                lambda figure: _draw(figure, sizes, "particles", "number of particles N"),
            ),
            Drawing(
                "box_end_time",
                "Mean growth against the end time, with 95 % bands.",
                lambda figure: _draw(figure, times, "end time (s)", "end time T (s)"),
            ),
        ),
        tables=(
            Table("box_particles", "One row is one number of particles.", sizes, SHOWN),
            Table("box_end_time", "One row is one end time.", times, SHOWN),
        ),
        failures=tuple(_failures(sizes)) + tuple(_failures(times)),
        conclusions=(
            *_conclusions(sizes, own, "particles", "particles", "the number of particles"),
            *_conclusions(times, end_time, "end time (s)", "s", "the end time"),
        ),
    )


def measure(
    campaign: Campaign,
    parameters: NDArray[np.float64],
    samples: Mapping[str, Rows],
    quick: bool,
) -> "tuple[pd.DataFrame, pd.DataFrame]":
    """Growth, objective and cost against N, and against T."""
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
    value, error = campaign.objective.build(particles).of_rows(good)
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
        "seconds per sample (s)": float(np.mean(rows["seconds"])),
    }


SHOWN: Final = (
    Shown("N", lambda row: f"{row['particles']:.0f}"),
    Shown("T", lambda row: f"{row['end time (s)']:.3g} s"),
    Shown("samples", lambda row: f"{row['samples']:.0f}"),
    Shown(
        "mean b/b⁰",
        lambda row: format_mean(
            MeanEstimate(row["mean b/b0"], row["standard error"], row["samples"])
        ),
    ),
    Shown("spread of one sample", lambda row: f"{row['spread of samples']:.2g}"),
    Shown(
        "objective",
        lambda row: format_mean(
            MeanEstimate(row["objective"], row["standard error of the objective"], row["samples"])
        ),
    ),
    Shown("time per sample", lambda row: format_seconds(row["seconds per sample (s)"])),
)


def _draw(
    figure: "matplotlib.figure.Figure", frame: "pd.DataFrame", column: str, label: str
) -> None:
    mean, half = frame["mean b/b0"], frame["half width"]
    curve = Curve("mean b/b⁰", frame[column], mean, mean - half, mean + half)
    axes = draw_curves(figure, [curve], label, "mean b/b⁰", scales=("log", "linear"))
    axes.set_xticks(list(frame[column]), [_plain(value) for value in frame[column]])
    axes.minorticks_off()


def _failures(frame: "pd.DataFrame") -> Iterator[str]:
    for _, row in frame[frame["failed"] > 0].iterrows():
        yield (
            f"N = {row['particles']:.0f}, T = {row['end time (s)']:.3g} s: {row['failed']:.0f} of "
            f"{row['samples']:.0f} samples failed."
        )


def _conclusions(
    frame: "pd.DataFrame", own: float, column: str, unit: str, what: str
) -> Iterator[str]:
    home = frame[frame[column] == own].iloc[0]
    for place in (frame.iloc[0], frame.iloc[-1]):
        change = MeanEstimate(
            place["mean b/b0"] - home["mean b/b0"],
            float(np.hypot(place["standard error"], home["standard error"])),
            int(place["samples"]),
        )
        beyond = abs(change.value) > change.half_width
        yield (
            f"{place[column] / own:.3g} times {what} ({_plain(place[column])} {unit}) changes mean "
            f"b/b⁰ by {format_mean(change)} ({100 * change.value / home['mean b/b0']:+.1f} %), "
            f"{'beyond' if beyond else 'within'} the error, and the objective from "
            f"{home['objective']:.3f} to {place['objective']:.3f}, at "
            f"{format_digits(place['seconds per sample (s)'] / home['seconds per sample (s)'])} "
            f"times the "
            "time of a sample."
        )


def _plain(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
