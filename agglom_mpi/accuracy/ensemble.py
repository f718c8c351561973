"""How many samples does a string need, and does a stopping rule know when it has them?"""

from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.accuracy import ensemble_words as words
from agglom_mpi.accuracy.curves import Curve, draw_curves
from agglom_mpi.accuracy.ensemble_goal import at_goal, of_rules, round_goal
from agglom_mpi.accuracy.section import Section, Shown, Table
from agglom_mpi.accuracy.stopping_study import (
    OWN,
    Truth,
    campaigns_own,
    families,
    study,
    truth_of,
)
from agglom_mpi.formatting import format_percent
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.random_streams import search_stream
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.search.objectives import MaximumGrowth, RadiusObjective

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

    from agglom_mpi.config.campaign import Campaign

ORDERS: Final = 2000
QUICK_ORDERS: Final = 400

SHORTEST: Final = 1000
LONGEST: Final = 4000
"""Limits of the longest ensembles that are studied; the campaign's max_samples within them."""

MOST_DRAWS: Final = 2_000_000
"""Samples drawn in all, 100 MB of running statistics; longer ensembles have fewer orders."""

FEWEST_ROWS: Final = 10

ROUNDING: Final = 1e-12
"""Relative spread of a pool below which all its samples are equal."""

RANDOM_ORDER: Final = 201
"""Purpose of the random stream; see `search.streams`."""


def ensemble(campaign: "Campaign", rows: np.ndarray, quick: bool = False) -> Section:
    """Study the stopping rules on a pool of samples of one parameter string.

    Parameters
    ----------
    campaign
        Its objective and, unless it is a scene alone, its own rule; the greatest growth and no own
        rule, if the objective looks at more than mean radii.
    rows
        Samples as `OUTCOME` rows, shape (rows,); those that failed are left out.
    quick
        Draw fewer orders.
    """
    pool = rows[rows["state"] == COMPLETED]
    if len(pool) < FEWEST_ROWS:
        few = f"Of {len(rows)} samples {len(pool)} completed; a pool takes at least {FEWEST_ROWS}."
        return _nothing("no pool to draw from", failures=(few,))
    plan, particles = campaign.plan, campaign.scene.particles
    objective, other = campaign.objective.build(particles), False
    if not isinstance(objective, RadiusObjective):
        plan, objective, other = None, MaximumGrowth(particles), True
    truth = truth_of(pool, objective)
    most = min(max(plan.ensemble.max_samples, SHORTEST), LONGEST) if plan else SHORTEST
    if truth.spread <= ROUNDING * truth.mean:
        equal = f"All {len(pool)} samples have the same mean radius: one is enough for any rule."
        return _nothing(words.reference(len(pool), truth), conclusions=(equal,))
    orders = min(QUICK_ORDERS if quick else ORDERS, MOST_DRAWS // most)
    draws = search_stream(campaign.seed, RANDOM_ORDER).integers(0, len(pool), (most, orders))
    rules = families(truth, most)
    if plan and plan.ensemble.rule != "fixed":
        rules.append(campaigns_own(plan.ensemble, most))
    frame = study(pool, objective, rules, draws)
    goal = round_goal(truth)
    return Section(
        title=words.TITLE,
        problem=words.PROBLEM,
        reference=words.reference(len(pool), truth),
        setups=words.setups(orders, most, len(rows) - len(pool), plan and plan.ensemble, other),
        figures=_figures(frame, truth, most),
        tables=_tables(frame, goal),
        failures=words.failures(frame),
        conclusions=words.conclusions(frame, truth, goal),
    )


def _nothing(
    reference: str, failures: tuple[str, ...] = (), conclusions: tuple[str, ...] = ()
) -> Section:
    setups = "nothing was run"
    return Section(words.TITLE, words.PROBLEM, reference, setups, (), (), failures, conclusions)


def _figures(frame: "pd.DataFrame", truth: Truth, most: int) -> tuple[Drawing, ...]:
    rules = of_rules(frame)

    def error(figure: "matplotlib.figure.Figure") -> None:
        axes = draw_curves(
            figure,
            _curves(rules, "samples, mean", "rms error", ("rms error, low", "rms error, high")),
            "samples spent (mean)",
            "rms relative error of mean b/b$^0$",
        )
        count = np.geomspace(2.0, most)
        best = truth.spread / truth.mean / np.sqrt(count)
        axes.plot(count, best, "k--", linewidth=1.0, label="number fixed beforehand")
        axes.legend(frameon=False, fontsize="small")

    def belief(figure: "matplotlib.figure.Figure") -> None:
        axes = draw_curves(
            figure,
            _curves(rules, "error believed", "rms error", ("rms error, low", "rms error, high")),
            "relative error that the tolerance stands for",
            "rms relative error of mean b/b$^0$",
        )
        axes.axline((1e-2, 1e-2), (1e-3, 1e-3), color="0.5", linewidth=0.8)
        axes.legend(frameon=False, fontsize="small", loc="upper left")
        axes.set_ylim(top=5.0 * rules["rms error"].max())

    def coverage(figure: "matplotlib.figure.Figure") -> None:
        axes = draw_curves(
            figure,
            _curves(rules, "samples, mean", "coverage", ("coverage, low", "coverage, high")),
            "samples spent (mean)",
            "intervals that contain the truth",
            scales=("log", "linear"),
        )
        axes.axhline(0.95, color="0.5", linewidth=0.8)

    return (
        Drawing("ensemble_error", words.ERROR_CAPTION, error),
        Drawing("ensemble_belief", words.BELIEF_CAPTION, belief),
        Drawing("ensemble_coverage", words.COVERAGE_CAPTION, coverage),
    )


def _curves(frame: "pd.DataFrame", cost: str, error: str, band: tuple[str, str]) -> list[Curve]:
    spread = 1.96 * frame["coverage, standard error"]
    wide = frame.assign(
        **{
            "coverage, low": frame["coverage"] - spread,
            "coverage, high": np.minimum(frame["coverage"] + spread, 1.0),
        }
    )
    return [
        Curve(str(rule), rows[cost], rows[error], rows[band[0]], rows[band[1]])
        for rule, rows in wide.groupby("rule", sort=False)
    ]


def _tables(frame: "pd.DataFrame", goal: float) -> tuple[Table, ...]:
    import pandas as pd

    shown = (
        Shown("rule", lambda row: row["rule"]),
        Shown("TOL", lambda row: f"{row['tolerance']:.3g}"),
        Shown("believed", lambda row: f"{row['error believed']:.1e}"),
        Shown(
            "samples, mean (10 %, 90 %)",
            lambda row: (
                f"{row['samples, mean']:.0f} "
                f"({row['samples, 10 %']:.0f}, {row['samples, 90 %']:.0f})"
            ),
        ),
        Shown("rms error", lambda row: format_percent(row["rms error"])),
        Shown("median error", lambda row: format_percent(row["median error"])),
        Shown("by luck", lambda row: words.share(row, "stopped by luck")),
        Shown("95 % covers", lambda row: words.share(row, "coverage")),
        Shown("at max_samples", lambda row: format_percent(row["ended at max_samples"])),
    )
    own = frame[frame["rule"] == OWN]
    chosen = pd.concat([at_goal(of_rules(frame), goal), own])
    caption = words.table_caption(goal)
    everything = "Every rule at every tolerance; errors are relative, samples are counts."
    return (
        Table("ensemble_at_goal", caption, chosen, shown),
        Table("ensemble_rules", everything, frame),
    )
