"""Time integration before chaos sets in: engines against exact trajectories of a few spheres."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.accuracy.document import (
    Curve,
    ReportSection,
    ReportTable,
    Sentences,
    TableColumn,
    draw_curves,
)
from agglom_mpi.accuracy.few_body_reference import (
    DIAMETER,
    END_TIME,
    FRICTION,
    HEAD_ON_RESTITUTION,
    LONGEST_DELAY,
    SPEED,
    FewBodyCase,
    bonding,
    bouncing,
)
from agglom_mpi.accuracy.few_body_study import (
    CEILING,
    EDGE,
    FULL,
    QUICK,
    StudySettings,
    orders,
    study,
)
from agglom_mpi.accuracy.run_times import (
    quartile_names,
    shown_time,
    time_columns,
    time_name,
    time_text,
)
from agglom_mpi.accuracy.work_precision import cost_at
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.statistics import MeanEstimate

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

SEED: Final = 2004

TYPICAL: Final = "three in sequence"
UNSEEN: Final = "two pairs"
"""Cases of the figure of costs: one that suits every engine, and one that the adaptive engine does
not see coming."""
HEAD_ON: Final = "head-on"

GOAL: Final = 1e-4
"""Position error in box edges, at which costs are compared."""

LEAST_ORDER: Final = 0.5
"""Order of convergence above which a stepper counts as converging."""

ERROR: Final = "position error (box edges)"
TIME: Final = time_name("run")


def few_body_section(quick: bool = False) -> ReportSection:
    """Return the section on the engines in scenes of two to five spheres.

    Parameters
    ----------
    quick
        Take fewer steps and runs, and leave out the pressure law, which has to be compiled.
    """
    settings = QUICK if quick else FULL
    cases = bouncing() if quick else [*bouncing(), *bonding()]
    frame = study(cases, settings, np.random.default_rng(SEED))
    fits = orders(frame)
    sentences = _sentences(cases, settings, frame, fits)
    return ReportSection(
        title="Time integration of a few spheres, before chaos sets in",
        problem=sentences.paragraph("problem"),
        reference=sentences.paragraph("reference"),
        setups=sentences.paragraph("setups"),
        figures=_figures(frame, sentences),
        tables=_tables(frame, fits, sentences),
        failures=sentences.items("failures"),
        conclusions=sentences.items("conclusions"),
    )


def _sentences(
    cases: list[FewBodyCase], settings: StudySettings, frame: "pd.DataFrame", fits: "pd.DataFrame"
) -> Sentences:
    other_bonds = frame[frame["other bonds"] > 0]
    return Sentences(
        "few_body",
        cases=cases,
        settings=settings,
        edge=EDGE,
        ceiling=CEILING,
        diameter=DIAMETER,
        end_time=END_TIME,
        friction=FRICTION,
        longest_delay=LONGEST_DELAY,
        digits=float(np.finfo(np.longdouble).eps),
        goal=GOAL,
        event=frame[frame["engine"] == "event"],
        event_time=time_text(time_columns("run", frame[frame["engine"] == "event"][TIME]), "run"),
        orders=[_range_of_orders(fits, engine) for engine in ("fixed", "adaptive")],
        head_on=_measured_over_predicted(frame),
        costs=list(_costs(frame)),
        unconverged=list(_unconverged(frame, fits)),
        other_bonds=[row for _, row in other_bonds.iterrows()],
    )


def _range_of_orders(fits: "pd.DataFrame", engine: str) -> dict[str, Any]:
    """Return lowest and highest order of an engine over the scenes in which it converges.

    `deviation` is the largest distance from 1 in standard errors.
    """
    rows = fits[(fits["engine"] == engine) & (fits["position, order"] > LEAST_ORDER)]
    order, error = rows["position, order"], rows["position, order, standard error"]
    return {
        "engine": engine,
        "scenes": len(rows),
        "lowest": order.min(),
        "highest": order.max(),
        "deviation": np.max(np.abs(order - 1.0) / error),
    }


def _measured_over_predicted(frame: "pd.DataFrame") -> MeanEstimate:
    """Return the error of fixed steps head-on over e·w·Δt/4, mean over the steps."""
    rows = frame[(frame["scene"] == HEAD_ON) & (frame["engine"] == "fixed")]
    predicted = HEAD_ON_RESTITUTION * SPEED / 4.0 / EDGE * rows["step (s)"]
    ratio = rows["position error"] / predicted
    error = rows["position error, standard error"] / predicted
    spread = math.sqrt(float(np.sum(error**2))) / len(ratio)
    return MeanEstimate(float(np.mean(ratio)), spread, len(ratio))


def _costs(frame: "pd.DataFrame") -> Iterator[dict[str, Any]]:
    """Yield for each engine the median time of a run at the goal, in s, over the scenes."""
    for engine, rows in frame.groupby("engine", sort=False):
        seconds = [seconds_at(points, GOAL) for _, points in rows.groupby("scene")]
        reached = [second for second in seconds if second < math.inf]
        yield {
            "engine": engine,
            "seconds": float(np.median(reached)) if reached else math.inf,
            "missed": len(seconds) - len(reached),
            "scenes": len(seconds),
        }


def seconds_at(rows: "pd.DataFrame", goal: float) -> float:
    """Return the time of a run in s at which an engine reaches an error; inf if it never does.

    The errors are the upper ends of their 95 % intervals, and those of all finer steps count.
    """
    ordered = rows.sort_values("step (s)", ascending=False)
    return cost_at(_upper(ordered), ordered[TIME], goal)


def _unconverged(frame: "pd.DataFrame", fits: "pd.DataFrame") -> Iterator[dict[str, Any]]:
    """Yield the steppers that do not converge in a scene, with the error of their finest step."""
    for _, fit in fits[fits["position, order"] <= LEAST_ORDER].iterrows():
        rows = frame[(frame["scene"] == fit["scene"]) & (frame["engine"] == fit["engine"])]
        finest = rows.sort_values("step (s)").iloc[0]
        yield {
            "engine": fit["engine"],
            "scene": fit["scene"],
            "order": _order(fit, "position"),
            "step": finest["step (s)"],
            "error": finest["position error"],
        }


def _order(row: Any, what: str) -> str:
    """Return the order of convergence with its standard error, from a row of the fits."""
    if math.isnan(row[f"{what}, order"]):
        return "–"
    return f"{row[f'{what}, order']:.3f} ± {row[f'{what}, order, standard error']:.3f}"


def _figures(frame: "pd.DataFrame", sentences: Sentences) -> tuple[Drawing, ...]:
    def against_step(engine: str, label: str) -> Drawing:
        def draw(figure: "matplotlib.figure.Figure") -> None:
            rows = frame[frame["engine"] == engine]
            curves = [
                _curve(str(scene), points, "step (s)")
                for scene, points in rows.groupby("scene", sort=False)
            ]
            draw_curves(figure, curves, label, ERROR)

        return Drawing(f"few_{engine}", sentences.paragraph("step_caption", engine=engine), draw)

    def cost(figure: "matplotlib.figure.Figure") -> None:
        shown = frame[frame["scene"].isin((TYPICAL, UNSEEN))]
        low, high = quartile_names("run")
        curves = [
            _curve(f"{engine}: {scene}", points, TIME)._replace(
                cost_low=points[low], cost_high=points[high]
            )
            for (scene, engine), points in shown.groupby(["scene", "engine"], sort=False)
        ]
        draw_curves(figure, curves, TIME, ERROR)

    return (
        against_step("fixed", "time step (s)"),
        against_step("adaptive", "shortest step (s)"),
        Drawing("few_cost", sentences.paragraph("cost_caption"), cost),
    )


def _curve(label: str, rows: "pd.DataFrame", cost: str) -> Curve:
    error, upper = rows["position error"], _upper(rows)
    low = np.maximum(2.0 * error - upper, 1e-3 * error)  # a band that reaches zero has no logarithm
    return Curve(label, rows[cost], error, low, upper)


def _upper(rows: "pd.DataFrame") -> "pd.Series":
    """Return the upper end of the 95 % interval of each error."""
    return rows["position error"] + 1.96 * rows["position error, standard error"]


def _tables(
    frame: "pd.DataFrame", fits: "pd.DataFrame", sentences: Sentences
) -> tuple[ReportTable, ...]:
    def order(what: str) -> TableColumn:
        return TableColumn(f"order, {what}", lambda row: _order(row, what))

    def ratio(what: str, unit: str) -> TableColumn:
        name = f"{what}, error over step (1/s)"
        return TableColumn(
            f"{what} error over step ({unit})",
            lambda row: "–" if math.isnan(row[name]) else f"{row[name]:.3g}",
        )

    def exponent(name: str) -> TableColumn:
        return TableColumn(name, lambda row: f"{row[name]:.1e}")

    scene = TableColumn("scene", lambda row: row["scene"])
    of_orders = (
        scene,
        TableColumn("engine", lambda row: row["engine"]),
        order("position"),
        ratio("position", "edges/s"),
        order("velocity"),
        ratio("velocity", "1/s"),
    )
    of_event = (
        scene,
        TableColumn("runs", lambda row: str(row["runs"])),
        exponent("position error"),
        exponent("position error, largest"),
        exponent("velocity error, largest"),
        shown_time("run"),
    )
    event = frame[frame["engine"] == "event"]
    return (
        ReportTable("few_orders", sentences.paragraph("orders_caption"), fits, of_orders),
        ReportTable("few_event", sentences.paragraph("event_caption"), event, of_event),
        ReportTable(
            "few_runs", "Every scene, engine and step: errors and processor time per run.", frame
        ),
    )
