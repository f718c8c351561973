"""Time steps against exact times: the bias of growth and objective, and what it costs.

An error that is small at one setting and larger at a finer one is small by accident: a bias that
changes its sign passes through zero, and noise dips below any bound.
"""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agglom_mpi.accuracy.report import (
    Curve,
    ReportSection,
    ReportTable,
    Sentences,
    TableColumn,
    draw_curves,
    quartile_names,
    time_columns,
    time_name,
    time_text,
)
from agglom_mpi.accuracy.study import (
    Rows,
    Setup,
    StudyPart,
    completed,
    paired_difference,
    with_scene,
)
from agglom_mpi.analysis.tables import time_on_free_core
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.simulation.engines import AdaptiveSteps, Engine, EventDriven, FixedSteps
from agglom_mpi.statistics import MeanEstimate, mean_of

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd


def lasting(errors: ArrayLike, goal: float) -> NDArray[np.bool_]:
    """Return whether each error and those of all finer settings are at most `goal`, (n,).

    Parameters
    ----------
    errors
        Upper bounds of errors, the coarsest setting first, shape (n,); nan is within no goal.
    goal
        The error to reach.
    """
    within = np.asarray(errors, float) <= goal
    return np.logical_and.accumulate(within[::-1])[::-1]


def cost_at(errors: ArrayLike, costs: ArrayLike, goal: float) -> float:
    """Return the cost at which `goal` is reached to stay; inf if it never is.

    Between settings the logarithm of the cost is interpolated in that of the error; arguments as
    for `lasting`, costs of shape (n,).
    """
    error, cost = np.asarray(errors, float), np.asarray(costs, float)
    reached = np.flatnonzero(lasting(error, goal))
    if not len(reached):
        return math.inf
    k = int(reached[0])
    if k == 0 or math.isnan(error[k - 1]):
        return float(cost[k])
    share = math.log(error[k - 1] / goal) / math.log(error[k - 1] / error[k])
    return float(cost[k - 1] * (cost[k] / cost[k - 1]) ** share)


EVENT: Final = "event"
"""Name of the set-up that everything is measured against, also by other sections."""

STEPS: Final = (50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000)
QUICK_STEPS: Final = (50, 200, 1000)
FLOORS: Final = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
"""Shortest adaptive step over the end time; 1e-4 s … 1e-8 s where that is [B]'s 0.01 s."""
QUICK_FLOORS: Final = (1e-2, 1e-3)
CAPS: Final = (1000.0, 10.0, 1.0)
"""Longest over shortest adaptive step; the first is published [B 6.14]."""
TIME: Final = time_name("sample")
"""Column of the median time."""
AXIS: Final = "processor time of a sample (s)"
TOLERANCES: Final = (0.05, 0.01, 0.002)
"""Relative errors of growth that the conclusions speak of."""


class StudiedScene(NamedTuple):
    """A string whose settings are varied.

    Attributes
    ----------
    campaign, parameters
        The scene, and the string, shape (k,), SI units.
    samples
        Of each set-up.
    quick
        Whether to vary little.
    """

    campaign: Campaign
    parameters: NDArray[np.float64]
    samples: int
    quick: bool

    @property
    def end_time(self) -> float:
        """End time of the scene in s."""
        return self.campaign.at(self.parameters).build().end_time

    def setup(self, by: Engine | None = None, **changes: object) -> Setup:
        """Return the set-up with an engine in place of the scene's, or with other entries of it."""
        changed = with_scene(self.campaign, **changes) if changes else self.campaign
        return Setup(changed, self.parameters, self.samples, by)


class Stepper(NamedTuple):
    """A published stepper: name of its family, shortest step in s, and the engine."""

    family: str
    step: float
    engine: Engine

    @property
    def name(self) -> str:
        """Name of its set-up."""
        return f"{self.family}, {self.step:.3g} s"


def steppers(end_time: float, quick: bool) -> Iterator[Stepper]:
    """Yield the steppers to measure on a scene that ends at `end_time` in s, coarse ones first."""
    for steps in QUICK_STEPS if quick else STEPS:
        yield Stepper("fixed", end_time / steps, FixedSteps(steps=steps))
    for cap in CAPS[:1] if quick else CAPS:
        for share in QUICK_FLOORS if quick else FLOORS:
            floor = share * end_time
            family = f"adaptive, steps to {cap:g} × the floor"
            yield Stepper(family, floor, AdaptiveSteps(floor=floor, ceiling=cap * floor))


def event_engine(campaign: Campaign) -> Engine:
    """Return the event engine of a campaign, its own if it has one."""
    engine = campaign.scene.engine
    return EventDriven() if engine.has_time_steps else engine


def steps_part(scene: StudiedScene) -> StudyPart:
    """Return the part on the error of time steps: every stepper on the event engine's samples."""
    setups = {EVENT: scene.setup(event_engine(scene.campaign))}
    for stepper in steppers(scene.end_time, scene.quick):
        setups[stepper.name] = scene.setup(stepper.engine)
    return StudyPart(setups, lambda samples: _section(scene, samples))


def _section(scene: StudiedScene, samples: Mapping[str, Rows]) -> ReportSection:
    frame = measured_steps(scene, samples)
    cost = time_columns("sample", time_on_free_core(samples[EVENT]))
    sentences = Sentences(
        "time_integration",
        growth=mean_of(completed(samples[EVENT])["mean_radius_ratio"]),
        cost=cost[TIME],
        cost_text=time_text(cost, "sample"),
        time=TIME,
        end_time=scene.end_time,
        reached=[(tolerance, list(reached_by(frame, tolerance))) for tolerance in TOLERANCES],
        failed=[row for _, row in frame[frame["failed"] > 0].iterrows()],
        overlaps=frame.groupby("method", sort=False)["overlaps per sample"].max().items(),
    )
    figures = [
        Drawing(
            "time_integration",
            sentences.paragraph("bias_caption"),
            lambda figure: _draw_signed(figure, frame, cost[TIME]),
        ),
        Drawing(
            "time_integration_error",
            sentences.paragraph("error_caption"),
            lambda figure: _draw_error(figure, frame, cost[TIME]),
        ),
    ]
    table = ReportTable("time_integration", "One row is one set-up.", frame, STEP_COLUMNS)
    return sentences.section("Time integration", figures, [table])


def measured_steps(scene: StudiedScene, samples: Mapping[str, Rows]) -> "pd.DataFrame":
    """Return cost and bias of every stepper, one row each, from the samples of all set-ups."""
    import pandas as pd

    reference = samples[EVENT]
    growth = mean_of(completed(reference)["mean_radius_ratio"]).value
    rows = []
    for stepper in steppers(scene.end_time, scene.quick):
        own = samples[stepper.name]
        good = completed(own)
        bias = paired_difference(own, reference, "mean_radius_ratio")
        objective = objective_bias(scene.campaign, own, reference)
        rows.append(
            {
                "method": stepper.family,
                "shortest step (s)": stepper.step,
                "samples": len(own),
                "failed": len(own) - len(good),
                **time_columns("sample", time_on_free_core(own)),
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


def objective_bias(campaign: Campaign, own: Rows, reference: Rows) -> MeanEstimate:
    """Return the bias of the objective, signed where the objective is a magnitude."""
    objective = campaign.objective
    pair = []
    for rows in (completed(own), completed(reference)):
        deviations = np.zeros(len(rows), [("sample", "i8"), ("state", "u1"), ("value", "f8")])
        deviations["sample"], deviations["state"] = rows["sample"], rows["state"]
        deviations["value"] = objective.influence_values(objective.summaries(rows))
        pair.append(deviations)
    return paired_difference(pair[0], pair[1], "value")


STEP_COLUMNS: Final = (
    *TableColumn.plain("method"),
    TableColumn("shortest step", lambda row: f"{row['shortest step (s)']:.2g} s"),
    TableColumn.number("samples", ".0f"),
    TableColumn.number("failed", ".0f"),
    TableColumn.time("sample"),
    TableColumn.mean("bias of b/b⁰", "bias of b/b0", "standard error", "pairs"),
    TableColumn(
        "relative, ± 95 %",
        lambda row: f"{100 * row['relative bias']:+.2f} ± {100 * row['relative half width']:.2f} %",
    ),
    TableColumn.mean(
        "bias of the objective", "bias of objective", "standard error of that", "pairs"
    ),
    TableColumn.number("overlaps per sample", ".2g", "overlaps left"),
)


def _draw_signed(figure: "matplotlib.figure.Figure", frame: "pd.DataFrame", cost: float) -> None:
    curves = []
    for curve, rows in _curves(frame):
        bias, half = 100.0 * rows["relative bias"], 100.0 * rows["relative half width"]
        curves.append(curve._replace(error=bias, low=bias - half, high=bias + half))
    axes = draw_curves(figure, curves, AXIS, "bias of mean b/b⁰ (%)", scales=("log", "linear"))
    axes.axhline(0.0, color="0.5", linewidth=0.8)
    axes.plot([cost], [0.0], "k*", markersize=9, label="event")
    axes.legend(frameon=False, fontsize="small")


def _draw_error(figure: "matplotlib.figure.Figure", frame: "pd.DataFrame", cost: float) -> None:
    curves = [curve for curve, _ in _curves(frame)]
    axes = draw_curves(figure, curves, AXIS, "|bias| of mean b/b⁰, at most (%)")
    # No error has no place on a logarithmic axis: the star stands on its lower end.
    axes.axvline(cost, color="k", linewidth=0.8, linestyle=":")
    bottom = axes.get_xaxis_transform()
    event = "event, no error in time"
    axes.plot([cost], [0.0], "k*", markersize=9, label=event, transform=bottom, clip_on=False)
    axes.legend(edgecolor="none", fontsize="small")  # opaque over the spreads of times


def _curves(frame: "pd.DataFrame") -> Iterator[tuple[Curve, "pd.DataFrame"]]:
    """Yield the curve of each method's errors against the time of a sample, with its rows."""
    for method, rows in frame.groupby("method", sort=False):
        low, high = (rows[name] for name in quartile_names("sample"))
        error = 100.0 * _bound(rows)
        yield Curve(str(method), rows[TIME], error, cost_low=low, cost_high=high), rows


def _bound(rows: "pd.DataFrame") -> "pd.Series":
    """Return the largest relative error that the 95 % interval of each bias allows."""
    return rows["relative bias"].abs() + rows["relative half width"]


def reached_by(frame: "pd.DataFrame", tolerance: float) -> Iterator[dict[str, Any]]:
    """Yield of each method the cheapest set-up that is shown to reach a tolerance, or None.

    A set-up reaches it if the 95 % interval of its bias and those of all finer steps of its method
    lie within. `outside` is whether the finest steps are shown to be outside, `bound` the error
    that they are shown to be within.
    """
    for method, rows in frame.groupby("method", sort=False):  # the coarsest steps first
        bound = _bound(rows)
        reached = rows[lasting(bound, tolerance)].sort_values(TIME)
        finest = rows.iloc[-1]
        yield {
            "method": method,
            "setup": reached.iloc[0] if len(reached) else None,
            "outside": abs(finest["relative bias"]) - finest["relative half width"] > tolerance,
            "bound": float(bound.iloc[-1]),
        }
