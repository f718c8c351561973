"""What the study of a few spheres says, in words computed from its numbers."""

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.accuracy.few_scenes import (
    DIAMETER,
    END_TIME,
    FRICTION,
    HEAD_ON_RESTITUTION,
    LONGEST_DELAY,
    SPEED,
    FewBodies,
)
from agglom_mpi.accuracy.few_study import CEILING, EDGE, Knobs
from agglom_mpi.formatting import format_seconds

if TYPE_CHECKING:
    import pandas as pd

TYPICAL: Final = "three in sequence"
UNSEEN: Final = "two pairs"
HEAD_ON: Final = "head-on"

GOAL: Final = 1e-4
"""Position error in box edges, at which costs are compared."""

ERROR: Final = "position error (box edges)"

PROBLEM: Final = (
    "With many spheres, trajectories part exponentially and only averages can be compared. Before "
    "that, after a few impacts, the state itself can: how far from the exact positions and "
    "velocities is each engine, how does the error fall with the step, and what does it cost? The "
    "published steppers detect an overlap after a step, resolve the impact there and then, and "
    "shift the spheres along their outgoing velocities by their share of the overlap [A 8]."
)

COST_CAPTION: Final = (
    "Position error against run time of a run, in a scene that suits every engine and in the one "
    "that the adaptive engine does not see; one point per step, and one for the event engine."
)

DESCRIPTIONS: Final = {
    "head-on": "two spheres head-on",
    "oblique": "two that strike obliquely and rub",
    "across a corner": "the same through a corner of the periodic box",
    "cradle of five": "five in a row, of which the first strikes and passes it on",
    "three in sequence": "one that strikes a second, which strikes a third, neither in line",
    "two pairs": "two that fly side by side and strike two that rest side by side",
    "bond, then bounce": "two that bond, and then bounce off a third by the pressure law",
}


def reference() -> str:
    """Say what errors are measured against."""
    digits = np.finfo(np.longdouble).eps
    return (
        "The exact trajectory: straight flight, and impacts at the roots of quadratics, written "
        "separately from every engine in plain Python with numbers that are exact to "
        f"{float(digits):.1e}. The error of a run is the root mean square over its spheres of the "
        f"distance to where they should be at the end, in edges of the box, {100.0 * EDGE:g} cm, "
        "and of the difference in velocity, in m/s; spheres meet at about 1 m/s."
    )


def setups(scenes: list[FewBodies], knobs: Knobs) -> str:
    """Say what was run."""
    told = "; ".join(f"{scene.name}: {DESCRIPTIONS[scene.name]}" for scene in scenes)
    return (
        f"Spheres of {1e3 * DIAMETER:g} mm in a periodic cube for {1e3 * END_TIME:g} ms, with "
        f"constant restitution and friction {FRICTION:g} unless told otherwise. {told}. The error "
        "of a stepper depends on where in a step an impact falls, so each number is the mean over "
        f"{knobs.runs} runs whose start is delayed at random by up to {1e3 * LONGEST_DELAY:g} ms. "
        f"Fixed: {knobs.steps[0]} to {knobs.steps[-1]} steps. Adaptive: shortest step "
        f"{knobs.floors[0]:g} s to {knobs.floors[-1]:g} s, longest {CEILING:g} s [B 6.14]. Event: "
        "no knob."
    )


def step_caption(engine: str) -> str:
    """Say what the figure of a stepper shows."""
    step = (
        "its step" if engine == "fixed" else f"its shortest step, the longest being {CEILING:g} s"
    )
    return f"Position error of the {engine} engine against {step}, with 95 % bands of the mean."


def order(row: Any, what: str) -> str:
    """Order of convergence with its standard error, from a row of the fits."""
    if math.isnan(row[f"{what}, order"]):
        return "–"
    return f"{row[f'{what}, order']:.3f} ± {row[f'{what}, order, standard error']:.3f}"


def seconds_at(rows: "pd.DataFrame", goal: float) -> float:
    """Seconds of a run at which an engine reaches an error, between its steps; inf: never."""
    ordered = rows.sort_values("step (s)", ascending=False)
    error = ordered["position error"].to_numpy()
    seconds = ordered["seconds per run (s)"].to_numpy()
    reached = np.flatnonzero(error <= goal)
    if not len(reached):
        return math.inf
    k = int(reached[0])
    if k == 0:
        return float(seconds[0])
    way = math.log(error[k - 1] / goal) / math.log(error[k - 1] / error[k])
    return float(seconds[k - 1] * (seconds[k] / seconds[k - 1]) ** way)


def conclusions(frame: "pd.DataFrame", fits: "pd.DataFrame") -> tuple[str, ...]:
    """Say what the numbers say."""
    converging = fits[fits["position, order"] > 0.5]
    return (
        _event(frame),
        *(_orders(converging, engine) for engine in ("fixed", "adaptive")),
        _left_over(frame),
        _costs(frame),
    )


def _event(frame: "pd.DataFrame") -> str:
    rows = frame[frame["engine"] == "event"]
    return (
        f"The event engine is off by {rows['position error, largest'].max():.1e} box edges and "
        f"{rows['velocity error, largest'].max():.1e} m/s at most, in {rows['runs'].sum()} runs of "
        f"{len(rows)} scenes; a run takes {format_seconds(rows['seconds per run (s)'].median())}."
    )


def _orders(fits: "pd.DataFrame", engine: str) -> str:
    rows = fits[fits["engine"] == engine]
    low, high = rows["position, order"].min(), rows["position, order"].max()
    away = np.max(np.abs(rows["position, order"] - 1.0) / rows["position, order, standard error"])
    step = "step" if engine == "fixed" else "shortest step"
    if rows.empty:
        return f"The {engine} engine converges in no scene."
    return (
        f"The {engine} engine converges with order {low:.2f} to {high:.2f} in its {step} in "
        f"{len(rows)} scenes, at most {away:.1f} standard errors from 1: half the step, half "
        "the error."
    )


def _left_over(frame: "pd.DataFrame") -> str:
    rows = frame[(frame["scene"] == HEAD_ON) & (frame["engine"] == "fixed")]
    predicted = HEAD_ON_RESTITUTION * SPEED / 4.0 / EDGE * rows["step (s)"]
    ratio = rows["position error"] / predicted
    error = rows["position error, standard error"] / predicted
    mean = float(np.mean(ratio))
    spread = math.sqrt(float(np.sum(error**2))) / len(ratio)
    return (
        "The shift [A 8] does not make good for the delay: of two equal spheres that meet head-on "
        "and are resolved a time τ too late each stays e·w·τ/2 from its exact place, e·w·Δt/4 on "
        f"average over the phase; measured over predicted is {mean:.3f} ± {spread:.3f}."
    )


def _costs(frame: "pd.DataFrame") -> str:
    told = []
    for engine, rows in frame.groupby("engine", sort=False):
        seconds = [seconds_at(points, GOAL) for _, points in rows.groupby("scene")]
        reached = [second for second in seconds if second < math.inf]
        missed = len(seconds) - len(reached)
        text = f"{engine} {format_seconds(float(np.median(reached)))}" if reached else f"{engine} –"
        told.append(f"{text} (not reached in {missed} of {len(seconds)})" if missed else text)
    return f"At {GOAL:g} box edges, median of the scenes, a run takes: {', '.join(told)}."


def failures(frame: "pd.DataFrame", fits: "pd.DataFrame") -> tuple[str, ...]:
    """Say where an engine does not converge, and where it bonds others than it should."""
    told = []
    for _, fit in fits[fits["position, order"] <= 0.5].iterrows():
        rows = frame[(frame["scene"] == fit["scene"]) & (frame["engine"] == fit["engine"])]
        finest = rows.sort_values("step (s)").iloc[0]
        told.append(
            f"{fit['engine'].capitalize()}, {fit['scene']}: no convergence, order "
            f"{order(fit, 'position')}; at a step of {finest['step (s)']:g} s the error is still "
            f"{finest['position error']:.1e} box edges. Nearest neighbours alone choose the step, "
            f"and these do not approach each other; so it is the longest, {CEILING:g} s, however "
            "close the others come."
        )
    for _, row in frame[frame["other bonds"] > 0].iterrows():
        told.append(
            f"{row['engine'].capitalize()}, {row['scene']}: other spheres bonded than should, in "
            f"{row['other bonds']} of {row['runs']} runs at a step of {row['step (s)']:g} s."
        )
    return tuple(told)
