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
    seconds_of_exact,
    seconds_per_step,
)
from agglom_mpi.accuracy.curves import Curve, draw_curves
from agglom_mpi.accuracy.section import Section, Shown, Table
from agglom_mpi.formatting import format_digits, format_seconds
from agglom_mpi.physics.cooling import QuarticCooling
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.simulation.scene import Scene

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

NEAR: Final = 1.01
"""Temperature of a grain near its rest, over that."""
HOT: Final = (2.0, 10.0, 30.0)
"""Temperatures of hot grains, over that of the start or of the rest, whichever is higher."""
STEPS: Final = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
QUICK_STEPS: Final = (1, 10, 200)
STIFF: Final = 10.0
"""End of the runs in which grains cool noticeably, over the longest step of the start."""
PUBLISHED: Final = 200
"""Steps that [A] takes to the end time."""
FLOOR: Final = 1e-17
"""Relative error at which a logarithmic axis shows none."""


def cooling(scene: Scene, quick: bool = False) -> Section:
    """Section on cooling between impacts.

    Parameters
    ----------
    scene
        The scene whose grains cool; [B]'s radiation is the example where it has no cooling.
    quick
        Whether to measure fewer steps and temperatures.
    """
    grain = grain_of(scene)
    limits, errors = measure_limits(grain, scene, quick), measure_errors(grain, scene, quick)
    return Section(
        title="Cooling",
        problem=(
            "Between impacts a grain only cools. Published is one forward Euler step for each time "
            "step; how far off is it, and from which step on does it overshoot or go below 0 K?"
        ),
        reference=(
            "The exact solution, by the package: an integral of the time over the logarithm of the "
            "distance to the temperature of rest, to rounding; in the tests it agrees with closed "
            "forms and an adaptive quadrature. Taken in 1000 intervals instead of one it differs "
            f"by {errors['change in 1000 intervals'].max():.0e} of the temperature at most."
        ),
        setups=_setups(grain, scene),
        figures=(
            Drawing(
                "cooling",
                "Relative error of the temperature after the scene's end time against the step.",
                lambda figure: _draw(figure, errors[errors["run"] == "end time"], "step (s)"),
            ),
            Drawing(
                "cooling_stiff",
                "The same after runs in which the grains cool noticeably, against the step over "
                "its limit at the start, by the estimate. Crosses: went below 0 K on "
                "the way, where the package puts it to 0 K and counts it.",
                lambda figure: _draw(
                    figure, errors[errors["run"] == "stiff"], "step over the estimated limit"
                ),
            ),
        ),
        tables=(
            Table(
                "cooling_limits",
                "One row is a starting temperature: steps from which Euler steps overshoot the "
                "temperature of rest and go below 0 K, measured and by the estimate.",
                limits,
                LIMITS_SHOWN,
            ),
            Table("cooling_errors", "One row is a run from one temperature.", errors),
        ),
        failures=tuple(_failures(errors)),
        conclusions=tuple(_conclusions(limits, errors, scene)),
    )


def _setups(grain: Grain, scene: Scene) -> str:
    law = grain.law
    if isinstance(law, QuarticCooling):
        words = "the published law θ' ∝ (θ − θ₀)⁴ [A 18], which the package holds at θ₀"
        limit = "ρC/(4B(θ − θ₀)³)"
    else:
        words = (
            f"radiation [B 6.19–6.21] with emissivity {law.emissivity:g} and surroundings of "
            f"{law.surroundings:g} K, convection {law.convection:g} W/(m² K)"
        )
        limit = "mC/(4Bεa_sθ³)" if law.convection == 0.0 else "mC/(a_s(4Bεθ³ + h_c))"
    example = " The scene has no cooling: these are the values of [B], as an example."
    return (
        f"A grain of the scene, {scene.radius:.3g} m in radius, with a heat capacity of "
        f"{grain.capacity:.3g} J/K, by {words}; it tends to {grain.rest:.4g} K."
        f"{example if scene.cooling is None else ''} Runs to the scene's end time of "
        f"{span(scene.end_time)}, and stiff ones to {STIFF:g} times the limit of the start. The "
        f"limit is an estimate, {limit}, from the slope of the law at the start. Times are medians "
        "of loops over thousands of grains in one compiled kernel."
    )


def starts(grain: Grain, scene: Scene, quick: bool) -> tuple[float, ...]:
    """List starting temperatures in K: of the scene, near the rest, and hot ones; ascending."""
    base = max(grain.rest, scene.temperature) or 300.0
    found = [base * factor for factor in (HOT[1:2] if quick else HOT)]
    found += [NEAR * grain.rest] if grain.rest > 0.0 else []
    if not math.isclose(scene.temperature, grain.rest, rel_tol=1e-3) and scene.temperature > 0.0:
        found.append(scene.temperature)
    return tuple(sorted(found))


def measure_limits(grain: Grain, scene: Scene, quick: bool) -> "pd.DataFrame":
    """Find from which step Euler steps fail, and what a step costs, one row for each start."""
    import pandas as pd

    rows = []
    for start in starts(grain, scene, quick):
        limit = linear_limit(grain, start)
        rows.append(
            {
                "start (K)": start,
                "estimated limit (s)": limit,
                "overshoots from (s)": least_step(grain, start, "overshoots", limit),
                "negative from (s)": least_step(grain, start, "negative", limit),
                "end time over limit": scene.end_time / limit,
                "seconds per Euler step (s)": seconds_per_step(grain, start, 1e-3 * limit),
                "seconds exactly to end time (s)": seconds_of_exact(grain, start, scene.end_time),
                "seconds exactly, stiff (s)": seconds_of_exact(grain, start, STIFF * limit),
            }
        )
    return pd.DataFrame(rows)


def measure_errors(grain: Grain, scene: Scene, quick: bool) -> "pd.DataFrame":
    """Errors of Euler steps, one row for each start, end and number of steps."""
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
    """Time in a unit that suits it, long ones in s with an exponent."""
    return format_seconds(seconds) if seconds < 1e4 else f"{seconds:.2g} s"


def _ratio(row: Any, column: str) -> str:
    if math.isnan(row[column]):
        return "not found"
    return f"{span(row[column])} ({row[column] / row['estimated limit (s)']:.3g} ×)"


LIMITS_SHOWN: Final = (
    Shown("start", lambda row: f"{row['start (K)']:.0f} K"),
    Shown("limit, estimated", lambda row: span(row["estimated limit (s)"])),
    Shown("overshoots from (× limit)", lambda row: _ratio(row, "overshoots from (s)")),
    Shown("below 0 K from (× limit)", lambda row: _ratio(row, "negative from (s)")),
    Shown("end time over limit", lambda row: f"{row['end time over limit']:.2g}"),
    Shown("Euler step", lambda row: format_seconds(row["seconds per Euler step (s)"])),
    Shown("exact, end time", lambda row: format_seconds(row["seconds exactly to end time (s)"])),
    Shown("exact, stiff", lambda row: format_seconds(row["seconds exactly, stiff (s)"])),
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


def _failures(errors: "pd.DataFrame") -> Iterator[str]:
    names = {"end time": "to the end time", "stiff": "of the stiff runs"}
    for run, rows in errors.groupby("run", sort=False):
        for flaw, words in (("overshoots", "overshoot"), ("negative", "go below 0 K")):
            found = rows[rows[flaw]]
            if len(found):
                least = found["step over the estimated limit"].min()
                yield (
                    f"Euler steps {names[str(run)]}: {len(found)} of {len(rows)} runs {words}, "
                    f"with steps from {format_digits(least)} times the estimated limit."
                )


def _conclusions(limits: "pd.DataFrame", errors: "pd.DataFrame", scene: Scene) -> Iterator[str]:
    yield from _on_the_scene(limits, errors[errors["run"] == "end time"], scene)
    for _, row in limits.iterrows():
        if not math.isnan(row["overshoots from (s)"]):
            yield (
                f"From {row['start (K)']:.0f} K Euler steps overshoot from "
                f"{_times(row, 'overshoots from (s)')}, and go below 0 K from "
                f"{_times(row, 'negative from (s)')}."
            )
    stiff = errors[errors["run"] == "stiff"]
    finest = stiff[stiff["steps"] == stiff["steps"].max()]["relative error"].max()
    yield (
        f"In the stiff runs {stiff['steps'].max()} Euler steps leave a relative error of up to "
        f"{finest:.1g}; the exact solution takes them in one."
    )
    step = limits["seconds per Euler step (s)"].median()
    own = limits["seconds exactly to end time (s)"].median()
    far = limits["seconds exactly, stiff (s)"].median()
    yield (
        f"An Euler step of one grain takes {format_seconds(step)}. Exactly to the end time takes "
        f"{format_seconds(own)}, as long as {format_digits(own / step)} steps, and through a "
        f"stiff run {format_seconds(far)}; "
        "but it is asked for only when a grain collides, and a step is taken by all at every step."
    )


def _times(row: Any, column: str) -> str:
    """Step with a flaw, and how it compares with the estimate."""
    if math.isnan(row[column]):
        return "no step that was tried"
    share = row[column] / row["estimated limit (s)"]
    return f"{span(row[column])} ({share:.3g} times the estimated limit)"


def _on_the_scene(limits: "pd.DataFrame", errors: "pd.DataFrame", scene: Scene) -> Iterator[str]:
    published = errors[errors["steps"] == PUBLISHED]
    worst = published.sort_values("relative error").iloc[-1]
    yield (
        f"After the scene's {span(scene.end_time)}, {PUBLISHED} Euler steps are off by "
        f"{worst['relative error']:.1g} of the temperature at most (from "
        f"{worst['start (K)']:.0f} K, which cools by "
        f"{worst['start (K)'] - worst['exact (K)']:.2g} K)."
    )
    nearest = limits.sort_values("end time over limit").iloc[-1]
    share = nearest["end time over limit"]
    if share < 1.0:
        yield (
            f"One step over the whole run is {share:.1g} of the shortest estimated limit, that of "
            f"{nearest['start (K)']:.0f} K: no step of this scene can oscillate."
        )
    else:
        yield (
            f"From {nearest['start (K)']:.0f} K at least {math.ceil(share)} steps to the end time "
            "are needed to stay within the estimated limit."
        )
