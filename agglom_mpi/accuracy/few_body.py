"""Time integration before chaos sets in: engines against exact trajectories of a few spheres."""

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.accuracy import few_words as words
from agglom_mpi.accuracy.curves import Curve, draw_curves
from agglom_mpi.accuracy.few_scenes import bonding, bouncing
from agglom_mpi.accuracy.few_study import FULL, QUICK, orders, study
from agglom_mpi.accuracy.section import Section, Shown, Table
from agglom_mpi.report.drawing import Drawing

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

SEED: Final = 2004


def few_body(quick: bool = False) -> Section:
    """Study the engines in scenes of two to five spheres.

    Parameters
    ----------
    quick
        Take fewer steps and runs, and leave out the pressure law, which has to be compiled.
    """
    knobs = QUICK if quick else FULL
    scenes = bouncing() if quick else [*bouncing(), *bonding()]
    frame = study(scenes, knobs, np.random.default_rng(SEED))
    fits = orders(frame)
    return Section(
        title="Time integration of a few spheres, before chaos sets in",
        problem=words.PROBLEM,
        reference=words.reference(),
        setups=words.setups(scenes, knobs),
        figures=_figures(frame),
        tables=_tables(frame, fits),
        failures=words.failures(frame, fits),
        conclusions=words.conclusions(frame, fits),
    )


def _figures(frame: "pd.DataFrame") -> tuple[Drawing, ...]:
    def against_step(engine: str, label: str) -> Drawing:
        def draw(figure: "matplotlib.figure.Figure") -> None:
            rows = frame[frame["engine"] == engine]
            curves = [
                _curve(str(scene), points, "step (s)")
                for scene, points in rows.groupby("scene", sort=False)
            ]
            draw_curves(figure, curves, label, words.ERROR)

        return Drawing(f"few_{engine}", words.step_caption(engine), draw)

    def cost(figure: "matplotlib.figure.Figure") -> None:
        shown = frame[frame["scene"].isin((words.TYPICAL, words.UNSEEN))]
        curves = [
            _curve(f"{engine}: {scene}", points, "seconds per run (s)")
            for (scene, engine), points in shown.groupby(["scene", "engine"], sort=False)
        ]
        draw_curves(figure, curves, "seconds per run (s)", words.ERROR)

    return (
        against_step("fixed", "time step (s)"),
        against_step("adaptive", "shortest step (s)"),
        Drawing("few_cost", words.COST_CAPTION, cost),
    )


def _curve(label: str, rows: "pd.DataFrame", cost: str) -> Curve:
    error = rows["position error"]
    half = 1.96 * rows["position error, standard error"]
    low = np.maximum(error - half, 1e-3 * error)  # a band that reaches zero has no logarithm
    return Curve(label, rows[cost], error, low, error + half)


def _tables(frame: "pd.DataFrame", fits: "pd.DataFrame") -> tuple[Table, ...]:
    def order(what: str) -> Shown:
        return Shown(f"order, {what}", lambda row: words.order(row, what))

    def ratio(what: str, unit: str) -> Shown:
        name = f"{what}, error over step (1/s)"
        return Shown(
            f"{what} error over step ({unit})",
            lambda row: "–" if math.isnan(row[name]) else f"{row[name]:.3g}",
        )

    def exponent(name: str) -> Shown:
        return Shown(name, lambda row: f"{row[name]:.1e}")

    event = frame[frame["engine"] == "event"]
    return (
        Table(
            "few_orders",
            "Order of convergence of each stepper in each scene, with its standard error, and the "
            "error as a multiple of the step; – where the error is rounding alone.",
            fits,
            (
                Shown("scene", lambda row: row["scene"]),
                Shown("engine", lambda row: row["engine"]),
                order("position"),
                ratio("position", "edges/s"),
                order("velocity"),
                ratio("velocity", "1/s"),
            ),
        ),
        Table(
            "few_event",
            "The event engine in each scene: errors of final positions in box edges, of velocities "
            "in m/s.",
            event,
            (
                Shown("scene", lambda row: row["scene"]),
                Shown("runs", lambda row: str(row["runs"])),
                exponent("position error"),
                exponent("position error, largest"),
                exponent("velocity error, largest"),
                exponent("seconds per run (s)"),
            ),
        ),
        Table("few_runs", "Every scene, engine and step: errors and seconds per run.", frame),
    )
