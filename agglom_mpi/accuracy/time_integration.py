"""Time steps against exact times: the bias of growth and objective, and what it costs."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.curves import Curve, draw_curves
from agglom_mpi.accuracy.section import Section, Shown, Table
from agglom_mpi.accuracy.statistics import completed, paired_difference
from agglom_mpi.accuracy.trials import Trial
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.scene import AdaptiveEngine, Engine, EventEngine, FixedEngine
from agglom_mpi.formatting import format_digits, format_mean, format_percent, format_seconds
from agglom_mpi.outcome import summaries as outcomes
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.statistics import MeanEstimate, mean_of

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

Rows = NDArray[np.void]

EVENT: Final = "event"
"""The trial that everything is measured against, also by other sections."""

STEPS: Final = (50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000)
QUICK_STEPS: Final = (50, 200, 1000)
FLOORS: Final = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
"""Shortest adaptive step over the end time; 1e-4 s … 1e-8 s where that is [B]'s 0.01 s."""
QUICK_FLOORS: Final = (1e-2, 1e-3)
CAPS: Final = (1000.0, 10.0, 1.0)
"""Longest over shortest adaptive step; the first is published [B 6.14]."""
TOLERANCES: Final = (0.05, 0.01, 0.002)
"""Relative errors of growth that the conclusions speak of."""
CONFIDENCE: Final = "95 %"


class Stepper(NamedTuple):
    """A published way of stepping, with its shortest step in s."""

    family: str
    step: float
    engine: Engine


def steppers(end_time: float, quick: bool) -> Iterator[Stepper]:
    """Steppers to measure on a scene that ends at `end_time` in s, coarse ones first."""
    for steps in QUICK_STEPS if quick else STEPS:
        yield Stepper("fixed", end_time / steps, FixedEngine(steps=steps))
    for cap in CAPS[:1] if quick else CAPS:
        for share in QUICK_FLOORS if quick else FLOORS:
            floor = share * end_time
            family = f"adaptive, steps to {cap:g} × the floor"
            yield Stepper(family, floor, AdaptiveEngine(floor=floor, ceiling=cap * floor))


def name_of(stepper: Stepper) -> str:
    """Name of a stepper's trial."""
    return f"{stepper.family}, {stepper.step:.3g} s"


def end_time_of(campaign: Campaign, parameters: NDArray[np.float64]) -> float:
    """End time of a campaign's scene in s."""
    return campaign.scene.build(parameters).end_time


def trials(
    campaign: Campaign, parameters: NDArray[np.float64], samples: int, quick: bool
) -> dict[str, Trial]:
    """Return the trials of the section: the event engine, and every stepper on its samples."""
    chosen = {EVENT: Trial(campaign, parameters, samples, event_engine(campaign))}
    for stepper in steppers(end_time_of(campaign, parameters), quick):
        chosen[name_of(stepper)] = Trial(campaign, parameters, samples, stepper.engine)
    return chosen


def event_engine(campaign: Campaign) -> EventEngine:
    """Event engine of a campaign, its own if it has one."""
    engine = campaign.scene.engine
    return engine if isinstance(engine, EventEngine) else EventEngine()


def time_integration(
    campaign: Campaign,
    parameters: NDArray[np.float64],
    samples: Mapping[str, Rows],
    quick: bool,
) -> Section:
    """Section on the error of time steps.

    Parameters
    ----------
    campaign, parameters
        The scene and the string, shape (10,), SI units.
    samples
        Rows of each of `trials`.
    quick
        Whether the quick trials ran.
    """
    frame = measure(campaign, parameters, samples, quick)
    reference = mean_of(completed(samples[EVENT])["mean_radius_ratio"])
    cost = float(np.mean(samples[EVENT]["seconds"]))
    return Section(
        title="Time integration",
        problem=(
            "How far from the truth is the mean growth b/b⁰ when time goes in steps, as both "
            "papers have it, and what does a sample cost?"
        ),
        reference=(
            "The event engine, which computes the time of every impact from a quadratic and makes "
            f"no error in time: mean b/b⁰ = {format_mean(reference)} over {reference.samples} "
            f"samples, {format_seconds(cost)} each. Every method starts from the same random "
            f"configurations, "
            "so the bias is a mean of paired differences; bands are 95 % t intervals of it."
        ),
        setups=(
            f"`fixed` [A]: equal steps; `adaptive` [B 6.14]: steps to the next contact of nearest "
            f"neighbours, between a floor and a cap. End time "
            f"{end_time_of(campaign, parameters):.4g} s. Seconds are those of one core with all "
            "cores of the machine at work."
        ),
        figures=(
            Drawing(
                "time_integration",
                "Bias of the mean growth against the time of a sample, with 95 % bands; the event "
                "engine is the star on the zero line.",
                lambda figure: _draw_signed(figure, frame, cost),
            ),
            Drawing(
                "time_integration_error",
                "The same as an error: the largest that the 95 % interval of the bias allows.",
                lambda figure: _draw_error(figure, frame),
            ),
        ),
        tables=(Table("time_integration", "One row is one set-up.", frame, SHOWN),),
        failures=tuple(_failures(frame)),
        conclusions=tuple(_conclusions(frame, cost)),
    )


def measure(
    campaign: Campaign,
    parameters: NDArray[np.float64],
    samples: Mapping[str, Rows],
    quick: bool,
) -> "pd.DataFrame":
    """Work and precision of every stepper, one row each."""
    import pandas as pd

    reference = samples[EVENT]
    growth = mean_of(completed(reference)["mean_radius_ratio"]).value
    rows = []
    for stepper in steppers(end_time_of(campaign, parameters), quick):
        own = samples[name_of(stepper)]
        good = completed(own)
        bias = paired_difference(own, reference, "mean_radius_ratio")
        objective = _objective_bias(campaign, own, reference)
        rows.append(
            {
                "method": stepper.family,
                "shortest step (s)": stepper.step,
                "samples": len(own),
                "failed": len(own) - len(good),
                "seconds per sample (s)": float(np.mean(own["seconds"])),
                "bias of b/b0": bias.value,
                "standard error": bias.error,
                "relative bias": bias.value / growth,
                "relative half width": bias.half_width / growth,
                "bias of objective": objective.value,
                "standard error of that": objective.error,
                "overlaps per sample": float(np.mean(good["overlaps"])) if len(good) else np.nan,
                "pairs": bias.samples,
            }
        )
    return pd.DataFrame(rows)


def _objective_bias(campaign: Campaign, own: Rows, reference: Rows) -> MeanEstimate:
    """Bias of the objective, signed where it is a magnitude."""
    objective = campaign.objective.build(campaign.scene.particles)
    pair = []
    for rows in (completed(own), completed(reference)):
        deviations = np.zeros(len(rows), [("sample", "i8"), ("state", "u1"), ("value", "f8")])
        deviations["sample"], deviations["state"] = rows["sample"], rows["state"]
        deviations["value"] = objective.linear(outcomes(rows))
        pair.append(deviations)
    return paired_difference(pair[0], pair[1], "value")


SHOWN: Final = (
    Shown("method", lambda row: row["method"]),
    Shown("shortest step", lambda row: f"{row['shortest step (s)']:.2g} s"),
    Shown("samples", lambda row: f"{row['samples']:.0f}"),
    Shown("failed", lambda row: f"{row['failed']:.0f}"),
    Shown("time per sample", lambda row: format_seconds(row["seconds per sample (s)"])),
    Shown(
        "bias of b/b⁰",
        lambda row: format_mean(
            MeanEstimate(row["bias of b/b0"], row["standard error"], row["pairs"])
        ),
    ),
    Shown("relative", lambda row: f"{100 * row['relative bias']:+.2f} %"),
    Shown(
        "bias of the objective",
        lambda row: format_mean(
            MeanEstimate(row["bias of objective"], row["standard error of that"], row["pairs"])
        ),
    ),
    Shown("overlaps left", lambda row: f"{row['overlaps per sample']:.2g}"),
)


def _draw_signed(figure: "matplotlib.figure.Figure", frame: "pd.DataFrame", cost: float) -> None:
    curves = []
    for family, rows in frame.groupby("method", sort=False):
        bias, half = 100.0 * rows["relative bias"], 100.0 * rows["relative half width"]
        curves.append(
            Curve(str(family), rows["seconds per sample (s)"], bias, bias - half, bias + half)
        )
    axes = draw_curves(
        figure,
        curves,
        "time of a sample (s)",
        "bias of mean b/b⁰ (%)",
        scales=("log", "linear"),
        zero=True,
    )
    axes.plot([cost], [0.0], "k*", markersize=9, label="event")
    axes.legend(frameon=False, fontsize="small")


def _draw_error(figure: "matplotlib.figure.Figure", frame: "pd.DataFrame") -> None:
    curves = []
    for family, rows in frame.groupby("method", sort=False):
        curves.append(Curve(str(family), rows["seconds per sample (s)"], 100.0 * _bound(rows)))
    draw_curves(figure, curves, "time of a sample (s)", "|bias| of mean b/b⁰, at most (%)")


def _bound(rows: "pd.DataFrame") -> "pd.Series":
    return rows["relative bias"].abs() + rows["relative half width"]


def _failures(frame: "pd.DataFrame") -> Iterator[str]:
    for _, row in frame[frame["failed"] > 0].iterrows():
        yield (
            f"{row['method']} with steps from {row['shortest step (s)']:.2g} s: {row['failed']:.0f}"
            f" of {row['samples']:.0f} samples failed."
        )
    for family, rows in frame.groupby("method", sort=False):
        worst = rows["overlaps per sample"].max()
        if worst >= 0.5:
            yield f"{family} leaves up to {worst:.2g} overlapping pairs in a sample."


def _conclusions(frame: "pd.DataFrame", cost: float) -> Iterator[str]:
    for tolerance in TOLERANCES:
        found = [f"event {format_seconds(cost)}"]
        for family, rows in frame.groupby("method", sort=False):
            found.append(f"{family} {_reached(rows, tolerance)}")
        yield f"At {100.0 * tolerance:g} % error of mean b/b⁰: {'; '.join(found)}."
    for family, rows in frame.groupby("method", sort=False):
        finest = rows.iloc[-1]
        yield (
            f"The finest steps of {family} are off by {100 * finest['relative bias']:+.2f} ± "
            f"{100 * finest['relative half width']:.2f} % ({CONFIDENCE}) at "
            f"{format_seconds(finest['seconds per sample (s)'])} a sample, "
            f"{format_digits(finest['seconds per sample (s)'] / cost)} times the event engine's."
        )


def _reached(rows: "pd.DataFrame", tolerance: float) -> str:
    """Cheapest set-up that is shown to be within a tolerance, or why there is none.

    One whose finer steps are shown to be outside is there by accident and does not count.
    """
    outside = rows["relative bias"].abs() - rows["relative half width"] > tolerance
    lasting = ~outside[::-1].cummax()[::-1].shift(-1, fill_value=False)
    within = rows[(_bound(rows) <= tolerance) & lasting]
    if len(within):
        best = within.sort_values("seconds per sample (s)").iloc[0]
        return (
            f"{format_seconds(best['seconds per sample (s)'])} (steps of "
            f"{best['shortest step (s)']:.2g} s)"
        )
    if outside.iloc[-1]:
        return "does not reach it"
    return f"is not shown to reach it (at best within {format_percent(float(_bound(rows).min()))})"
