"""Cooling by Euler steps as published against the exact solution: error, instability, time."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.accuracy.cooling_methods import (
    Grain,
    euler,
    exact,
    grain_of,
    least_step,
    linear_limit,
    times_of_exact,
    times_per_step,
)
from agglom_mpi.accuracy.document import (
    Curve,
    ReportSection,
    ReportTable,
    Sentences,
    TableColumn,
    draw_curves,
)
from agglom_mpi.accuracy.run_times import (
    WALL_OVER_CPU,
    ratio_of_clocks,
    shown_time,
    time_columns,
    time_name,
)
from agglom_mpi.compilation.stages import law_of
from agglom_mpi.formatting import format_seconds
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.simulation.scene import Scene

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

NEAR: Final = 1.01
"""Temperature of a grain near its rest temperature, over that."""
HOT: Final = (2.0, 10.0, 30.0)
"""Temperatures of hot grains, over the start or rest temperature, whichever is higher."""
STEPS: Final = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
QUICK_STEPS: Final = (1, 10, 200)
STIFF: Final = 10.0
"""End of the runs in which grains cool noticeably, over the longest step of the start."""
PUBLISHED: Final = 200
"""Steps that [A] takes to the end time."""
EULER_STEP: Final = "Euler step"
TO_END: Final = "exact run to the end time"
IN_STIFF: Final = "exact stiff run"
"""What is timed, as the columns name it."""
FLOOR: Final = 1e-17
"""Relative error at which a logarithmic axis shows none."""


def cooling_section(scene: Scene, quick: bool = False) -> ReportSection:
    """Return the section on cooling between impacts.

    Parameters
    ----------
    scene
        The scene whose grains cool; [B]'s radiation is the example where it has no cooling.
    quick
        Whether to measure fewer steps and temperatures.
    """
    grain = grain_of(scene)
    limits, errors = measure_limits(grain, scene, quick), measure_errors(grain, scene, quick)
    sentences = Sentences("cooling", **_findings(grain, scene, limits, errors))
    return ReportSection(
        title="Cooling",
        problem=sentences.paragraph("problem"),
        reference=sentences.paragraph("reference"),
        setups=sentences.paragraph("setups"),
        figures=(
            Drawing(
                "cooling",
                sentences.paragraph("end_time_caption"),
                lambda figure: _draw(figure, errors[errors["run"] == "end time"], "step (s)"),
            ),
            Drawing(
                "cooling_stiff",
                sentences.paragraph("stiff_caption"),
                lambda figure: _draw(
                    figure, errors[errors["run"] == "stiff"], "step over the estimated limit"
                ),
            ),
        ),
        tables=(
            ReportTable(
                "cooling_limits", sentences.paragraph("limits_caption"), limits, LIMIT_COLUMNS
            ),
            ReportTable("cooling_errors", "One row is a run from one temperature.", errors),
        ),
        failures=sentences.items("failures"),
        conclusions=sentences.items("conclusions"),
    )


def _findings(
    grain: Grain, scene: Scene, limits: "pd.DataFrame", errors: "pd.DataFrame"
) -> dict[str, Any]:
    """Return what the sentences of the section refer to."""
    to_end = errors[(errors["run"] == "end time") & (errors["steps"] == PUBLISHED)]
    stiff = errors[errors["run"] == "stiff"]
    most = stiff["steps"].max()
    return {
        "scene": scene,
        "grain": grain,
        "law": law_of(grain.law),
        "numbers": _numbers(grain),
        "stiff": STIFF,
        "published": PUBLISHED,
        "change": errors["change in 1000 intervals"].max(),
        "worst": to_end.sort_values("relative error").iloc[-1],
        "nearest": limits.sort_values("end time over limit").iloc[-1],
        "overshooting": [
            row for _, row in limits.iterrows() if not math.isnan(row["overshoots from (s)"])
        ],
        "finest": {
            "steps": most,
            "error": stiff[stiff["steps"] == most]["relative error"].max(),
        },
        "seconds": {
            "step": limits[time_name(EULER_STEP)].median(),
            "end_time": limits[time_name(TO_END)].median(),
            "stiff": limits[time_name(IN_STIFF)].median(),
        },
        "flaws": list(_flaws(errors)),
        "ceil": math.ceil,
        "span": span,
        "times": _times,
    }


def _numbers(grain: Grain) -> str:
    """Return the numbers of the grain's law, as text."""
    return "".join(f", {name} {value:g}" for name, value in grain.law._asdict().items())


def _flaws(errors: "pd.DataFrame") -> Iterator[dict[str, Any]]:
    """Yield the flaws that runs show, in how many of them, and with which shortest step."""
    for run, rows in errors.groupby("run", sort=False):
        for flaw in ("overshoots", "negative"):
            found = rows[rows[flaw]]
            if len(found):
                yield {
                    "run": run,
                    "flaw": flaw,
                    "count": len(found),
                    "runs": len(rows),
                    "least": found["step over the estimated limit"].min(),
                }


def starts(grain: Grain, scene: Scene, quick: bool) -> tuple[float, ...]:
    """Return starting temperatures in K, ascending: the scene's, near the rest, and hot ones."""
    base = max(grain.rest, scene.temperature) or 300.0
    found = [base * factor for factor in (HOT[1:2] if quick else HOT)]
    found += [NEAR * grain.rest] if grain.rest > 0.0 else []
    if not math.isclose(scene.temperature, grain.rest, rel_tol=1e-3) and scene.temperature > 0.0:
        found.append(scene.temperature)
    return tuple(sorted(found))


def measure_limits(grain: Grain, scene: Scene, quick: bool) -> "pd.DataFrame":
    """Return from which step Euler steps fail, and what a step costs, one row for each start."""
    import pandas as pd

    rows = []
    for start in starts(grain, scene, quick):
        limit = linear_limit(grain, start)
        step = times_per_step(grain, start, 1e-3 * limit)
        to_end = times_of_exact(grain, start, scene.end_time)
        in_stiff = times_of_exact(grain, start, STIFF * limit)
        rows.append(
            {
                "start (K)": start,
                "estimated limit (s)": limit,
                "overshoots from (s)": least_step(grain, start, "overshoots", limit),
                "negative from (s)": least_step(grain, start, "negative", limit),
                "end time over limit": scene.end_time / limit,
                **time_columns(EULER_STEP, [spent.cpu for spent in step]),
                **time_columns(TO_END, [spent.cpu for spent in to_end]),
                **time_columns(IN_STIFF, [spent.cpu for spent in in_stiff]),
                WALL_OVER_CPU: ratio_of_clocks([*step, *to_end, *in_stiff]),
            }
        )
    return pd.DataFrame(rows)


def measure_errors(grain: Grain, scene: Scene, quick: bool) -> "pd.DataFrame":
    """Return errors of Euler steps, one row for each start, end and number of steps."""
    import pandas as pd

    rows = []
    for start in starts(grain, scene, quick):
        limit = linear_limit(grain, start)
        for run, end in (("end time", scene.end_time), ("stiff", STIFF * limit)):
            reference = exact(grain, start, end)
            change = abs(exact(grain, start, end, 1000) - reference) / reference
            for steps in QUICK_STEPS if quick else STEPS:
                found = euler(grain, start, end / steps, steps)
                rows.append(
                    {
                        "run": run,
                        "start (K)": start,
                        "steps": steps,
                        "step (s)": end / steps,
                        "step over the estimated limit": end / steps / limit,
                        "exact (K)": reference,
                        "Euler (K)": found.temperature,
                        "relative error": abs(found.temperature - reference) / reference,
                        "overshoots": found.overshoots,
                        "negative": found.negative,
                        "change in 1000 intervals": change,
                    }
                )
    return pd.DataFrame(rows)


def span(seconds: float) -> str:
    """Return a time in a unit that suits it, long ones in s with an exponent."""
    return format_seconds(seconds) if seconds < 1e4 else f"{seconds:.2g} s"


def _ratio(row: Any, column: str) -> str:
    """Return the same for a cell of the table."""
    if math.isnan(row[column]):
        return "not found"
    return f"{span(row[column])} ({row[column] / row['estimated limit (s)']:.3g} ×)"


LIMIT_COLUMNS: Final = (
    TableColumn("start", lambda row: f"{row['start (K)']:.0f} K"),
    TableColumn("limit, estimated", lambda row: span(row["estimated limit (s)"])),
    TableColumn("overshoots from (× limit)", lambda row: _ratio(row, "overshoots from (s)")),
    TableColumn("below 0 K from (× limit)", lambda row: _ratio(row, "negative from (s)")),
    TableColumn("end time over limit", lambda row: f"{row['end time over limit']:.2g}"),
    shown_time(EULER_STEP),
    shown_time(TO_END),
    shown_time(IN_STIFF),
)


def _draw(figure: "matplotlib.figure.Figure", errors: "pd.DataFrame", cost: str) -> None:
    """Draw the errors against a column of them; crosses mark runs that went below 0 K."""
    shown = errors[np.isfinite(errors["relative error"])]
    shown = shown.assign(error=shown["relative error"].clip(lower=FLOOR))
    curves = [
        Curve(f"from {start:.0f} K", rows[cost], rows["error"])
        for start, rows in shown.groupby("start (K)")
    ]
    axes = draw_curves(figure, curves, cost, "relative error of θ")
    below = shown[shown["negative"]]
    axes.plot(below[cost], below["error"], "kx", markersize=8, label="went below 0 K")
    axes.legend(frameon=False, fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _times(row: Any, column: str) -> str:
    """Return the shortest step with a flaw and its ratio to the estimate, as text."""
    if math.isnan(row[column]):
        return "no step that was tried"
    share = row[column] / row["estimated limit (s)"]
    return f"{span(row[column])} ({share:.3g} times the estimated limit)"
