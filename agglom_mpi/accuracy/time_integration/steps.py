"""The published methods against exact times: the bias of growth and objective, and what it costs.

The time steps of both papers are varied, with all else exact. The published iteration of impacts,
and all of the published method, are measured as they are.

An error that is small at one setting and larger at a finer one is small by accident: a bias that
changes its sign passes through zero, and noise dips below any bound.
"""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agglom_mpi.accuracy.report import (
    QUARTILES,
    TIME,
    TIME_COLUMN,
    Curve,
    ReportSection,
    RowColumn,
    Sentences,
    draw_curves,
    frame_table,
    mean_column,
    time_columns,
    time_text,
)
from agglom_mpi.accuracy.soundness import summary
from agglom_mpi.accuracy.study import (
    Rows,
    Setup,
    StudyPart,
    completed,
    paired_difference,
    with_scene,
)
from agglom_mpi.accuracy.time_integration.published_method import as_published, event_engine
from agglom_mpi.analysis.tables import time_on_free_core
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.display.table import Column
from agglom_mpi.formatting import format_percent
from agglom_mpi.report.style import Drawing
from agglom_mpi.simulation.engines import AdaptiveSteps, Engine, FixedSteps
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
AXIS: Final = "processor time of a sample (s)"
STEP: Final = "shortest step (s)"
"""Column of the shortest step, nan for the published methods, whose steps are not varied."""
TOLERANCES: Final = (0.05, 0.01, 0.002)
"""Relative errors of growth that the conclusions speak of."""
ITERATION: Final = "published impact iteration, exact times"
WHOLE: Final = "published iteration, cooling and time steps"


class StudiedScene(NamedTuple):
    """A string whose settings are varied.

    Attributes
    ----------
    campaign, parameters
        The scene, and the string, shape (k,), SI units.
    samples
        Of each set-up but that of the event engine.
    pool
        Samples of the event engine, which all others are measured against.
    quick
        Whether to vary little.
    """

    campaign: Campaign
    parameters: NDArray[np.float64]
    samples: int
    pool: int
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


def published_setups(scene: StudiedScene) -> dict[str, Setup]:
    """Return the set-ups of the published methods that differ from the scene.

    A quick study has none: they would compile further kernels.
    """
    own, published, setups = scene.campaign.scene, as_published(scene.campaign.scene), {}
    if scene.quick:
        return {}
    if published.solver != own.solver:
        setups[ITERATION] = scene.setup(event_engine(scene.campaign), solver=published.solver)
    if published != own:
        setups[WHOLE] = scene.setup(None, **dict(published))
    return setups


def steps_part(scene: StudiedScene) -> StudyPart:
    """Return the part on published methods: each on the samples of the event engine.

    That engine's own samples are the pool of the stopping rules, too.
    """
    event = scene.setup(event_engine(scene.campaign))._replace(samples=scene.pool)
    setups = {EVENT: event}
    for stepper in steppers(scene.end_time, scene.quick):
        setups[stepper.name] = scene.setup(stepper.engine)
    setups |= published_setups(scene)
    return StudyPart(setups, lambda samples: _section(scene, samples))


def _section(scene: StudiedScene, samples: Mapping[str, Rows]) -> ReportSection:
    frame = measured_methods(scene, samples)
    steps = frame[frame[STEP].notna()]
    cost = time_columns(time_on_free_core(samples[EVENT]))
    sentences = Sentences(
        "time_integration",
        growth=mean_of(completed(samples[EVENT])["mean_radius_ratio"]),
        cost=cost[TIME],
        cost_text=time_text(cost),
        time=TIME,
        end_time=scene.end_time,
        reached=[(tolerance, list(reached_by(steps, tolerance))) for tolerance in TOLERANCES],
        engine=as_published(scene.campaign.scene).engine,
        published=[row for _, row in frame[frame[STEP].isna()].iterrows()],
        failed=[row for _, row in frame[frame["failed"] > 0].iterrows()],
        overlaps=steps.groupby("method", sort=False)["overlaps per sample"].max().items(),
    )
    figures = [
        Drawing(
            "time_integration_error",
            sentences.paragraph("error_caption"),
            lambda figure: _draw_error(figure, steps, cost[TIME]),
        ),
    ]
    table = frame_table(frame, "One row is one set-up.", "time_integration", METHOD_COLUMNS)
    return sentences.section("Time integration", figures, [table])


def measured_methods(scene: StudiedScene, samples: Mapping[str, Rows]) -> "pd.DataFrame":
    """Return cost and bias of every method, one row each, from the samples of all set-ups."""
    import pandas as pd

    reference = samples[EVENT]
    growth = mean_of(completed(reference)["mean_radius_ratio"]).value
    measured = [
        (each.name, each.family, each.step) for each in steppers(scene.end_time, scene.quick)
    ]
    measured += [(name, name, math.nan) for name in published_setups(scene)]
    rows = []
    for name, method, step in measured:
        own = samples[name]
        bias = paired_difference(own, reference, "mean_radius_ratio")
        objective = objective_bias(scene.campaign, own, reference)
        rows.append(
            {
                "method": method,
                STEP: step,
                **summary(own),
                "bias of b/b0": bias.value,
                "standard error of bias": bias.error,
                "relative bias": bias.value / growth,
                "relative half width": bias.half_width / growth,
                "bias of objective": objective.value,
                "standard error of that": objective.error,
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


METHOD_COLUMNS: Final = (
    Column("method", text=True),
    Column(STEP, "shortest step", format=lambda step: "–" if math.isnan(step) else f"{step:.2g} s"),
    Column("samples"),
    Column("failed"),
    TIME_COLUMN,
    mean_column("bias of b/b⁰", "bias of b/b0", "standard error of bias", "pairs"),
    RowColumn(
        "relative, ± 95 %",
        format=lambda row: (
            f"{100 * row['relative bias']:+.2f} ± {100 * row['relative half width']:.2f} %"
        ),
    ),
    mean_column("bias of the objective", "bias of objective", "standard error of that", "pairs"),
    Column("overlaps per sample", "overlaps left", format=".2g"),
    Column("unsolved impacts", format=format_percent),
)


def _draw_error(figure: "matplotlib.figure.Figure", frame: "pd.DataFrame", cost: float) -> None:
    axes = draw_curves(figure, list(_curves(frame)), AXIS, "|bias| of mean b/b⁰, at most (%)")
    # No error has no place on a logarithmic axis: the star stands on its lower end.
    axes.axvline(cost, color="k", linewidth=0.8, linestyle=":")
    bottom = axes.get_xaxis_transform()
    event = "event, no error in time"
    axes.plot([cost], [0.0], "k*", markersize=9, label=event, transform=bottom, clip_on=False)
    axes.legend(edgecolor="none")  # opaque over the spreads of times


def _curves(frame: "pd.DataFrame") -> Iterator[Curve]:
    """Yield the curve of each method's errors against the time of a sample."""
    for method, rows in frame.groupby("method", sort=False):
        low, high = (rows[name] for name in QUARTILES)
        error = 100.0 * _bound(rows)
        yield Curve(str(method), rows[TIME], error, cost_low=low, cost_high=high)


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
