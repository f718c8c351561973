"""How many samples does a string need, and does a stopping rule know when it has them?"""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.accuracy.report import (
    Curve,
    ReportSection,
    RowColumn,
    Sentences,
    draw_curves,
    frame_table,
)
from agglom_mpi.accuracy.study import Rows, StudyPart, completed
from agglom_mpi.accuracy.time_integration.steps import EVENT, StudiedScene
from agglom_mpi.accuracy.time_integration.stopping_study import (
    OWN,
    WITH_ERROR,
    Truth,
    at_goal,
    covers_too_little,
    families,
    of_rules,
    round_goal,
    samples_needed,
    study,
    truth_of,
)
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_percent
from agglom_mpi.random_streams import search_stream
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.search.objectives.growth import MaximumGrowth
from agglom_mpi.search.objectives.objective import RadiusObjective

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

ENSEMBLE_TITLE: Final = "Ensemble: how many samples, and when to stop"

ORDERS: Final = 2000
QUICK_ORDERS: Final = 400

SHORTEST: Final = 1000
LONGEST: Final = 4000
"""Limits of the longest ensembles that are studied; the campaign's max_samples within them."""

MOST_DRAWS: Final = 2_000_000
"""Samples drawn in all, 100 MB of running statistics; longer ensembles have fewer orders."""

FEWEST_ROWS: Final = 10
"""Completed samples that a pool needs."""

ROUNDING: Final = 1e-12
"""Relative spread of a pool below which all its samples are equal."""

RANDOM_ORDER: Final = 201
"""Purpose of the random stream; see `random_streams`."""


def ensemble_part(scene: StudiedScene) -> StudyPart:
    """Return the part on the stopping rules, on the pool of samples of the event engine."""

    def section(samples: Mapping[str, Rows]) -> ReportSection:
        return ensemble_section(scene.campaign, completed(samples[EVENT]), scene.quick)

    return StudyPart({}, section)


def ensemble_section(campaign: Campaign, rows: np.ndarray, quick: bool = False) -> ReportSection:
    """Return the section on the stopping rules, on a pool of samples of one parameter string.

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
    pool = completed(rows)
    values: dict[str, Any] = {"rows": len(rows), "pool": len(pool), "fewest": FEWEST_ROWS}
    if len(pool) < FEWEST_ROWS:
        return _nothing(values, "no pool to draw from", "too_few", failed=True)
    plan, objective = campaign.plan, campaign.objective
    values["other_objective"] = not isinstance(objective, RadiusObjective)
    if not isinstance(objective, RadiusObjective):
        plan, objective = None, MaximumGrowth().of_grains(campaign.scene.equivalent_grains)
    values["truth"] = truth = truth_of(pool, objective)
    if truth.spread <= ROUNDING * truth.mean:
        return _nothing(values, Sentences("ensemble", **values).paragraph("reference"), "all_equal")
    most = min(max(plan.ensemble.max_samples, SHORTEST), LONGEST) if plan else SHORTEST
    orders = min(QUICK_ORDERS if quick else ORDERS, MOST_DRAWS // most)
    draws = search_stream(campaign.seed, RANDOM_ORDER).integers(0, len(pool), (most, orders))
    rules = families(truth, most)
    if plan and plan.ensemble.is_adaptive:
        rules.append((OWN, plan.ensemble))
    frame, goal = study(pool, objective, rules, draws), round_goal(truth)
    sentences = Sentences(
        "ensemble",
        **values,
        orders=orders,
        most=most,
        failed=len(rows) - len(pool),
        own=plan and plan.ensemble,
        share=_share,
        flaws=list(_flaws(frame)),
        **_findings(frame, truth, goal),
    )
    figures, tables = _figures(frame, truth, most, sentences), _tables(frame, goal, sentences)
    return sentences.section(ENSEMBLE_TITLE, figures, tables)


def _nothing(
    values: dict[str, Any], reference: str, block: str, failed: bool = False
) -> ReportSection:
    """Return a section without figures and tables, with one failure or conclusion."""
    sentences = Sentences("ensemble", **values)
    problem, items = sentences.paragraph("problem"), (sentences.paragraph(block),)
    section = ReportSection(ENSEMBLE_TITLE, problem, reference, "nothing was run")
    return section._replace(failures=items) if failed else section._replace(conclusions=items)


def _share(row: Any, name: str) -> str:
    """Return a proportion and its standard error in percent, from the columns of a row."""
    if math.isnan(row[name]):
        return "–"
    return f"{100.0 * row[name]:.1f} ± {100.0 * row[f'{name}, standard error']:.1f} %"


def _findings(frame: "pd.DataFrame", truth: Truth, goal: float) -> dict[str, Any]:
    """Return what the conclusions refer to, with the mean samples that each rule takes."""
    rules, costs = of_rules(frame), []
    with_error = rules[rules["rule"] == WITH_ERROR]
    for rule, rows in rules.groupby("rule", sort=False):
        samples, best = samples_needed(rows, goal), rows["rms error"].min()
        costs.append(
            {"rule": rule, "reached": math.isfinite(samples), "samples": samples, "best": best}
        )
    return {
        "goal": goal,
        "samples_at_goal": (truth.spread / truth.mean / goal) ** 2,
        "costs": costs,
        "with_error": None if with_error.empty else at_goal(with_error, goal).iloc[0],
        "own_rows": [row for _, row in frame[frame["rule"] == OWN].iterrows()],
    }


def _flaws(frame: "pd.DataFrame") -> Iterator[dict[str, Any]]:
    """Yield for each rule where it stops by luck, covers too little, or does not stop."""
    for rule, rows in frame.groupby("rule", sort=False):
        known = rows[rows["stopped by luck"].notna()]
        bound = 0.05 + 4.0 * known["stopped by luck, standard error"]
        short = rows[covers_too_little(rows)]
        yield {
            "name": rule,
            "lucky": known[known["stopped by luck"] > bound],
            "short": short,
            "worst": None if short.empty else short.sort_values("coverage").iloc[0],
            "endless": rows[rows["ended at max_samples"] > 0.5],
        }


def _figures(
    frame: "pd.DataFrame", truth: Truth, most: int, sentences: Sentences
) -> tuple[Drawing, ...]:
    rules = of_rules(frame)
    spent, wrong = "samples spent (mean)", "rms relative error of mean b/b⁰"

    def error(figure: "matplotlib.figure.Figure") -> None:
        axes = draw_curves(figure, _curves(rules, "samples, mean"), spent, wrong)
        count = np.geomspace(2.0, most)
        best = truth.spread / truth.mean / np.sqrt(count)
        axes.plot(count, best, "k--", linewidth=1.0, label="number fixed beforehand")
        axes.legend()

    def belief(figure: "matplotlib.figure.Figure") -> None:
        believed = "relative error that the tolerance stands for"
        axes = draw_curves(figure, _curves(rules, "error believed"), believed, wrong)
        axes.axline((1e-2, 1e-2), (1e-3, 1e-3), color="0.5", linewidth=0.8)
        axes.legend(loc="upper left")
        axes.set_ylim(top=5.0 * rules["rms error"].max())

    def coverage(figure: "matplotlib.figure.Figure") -> None:
        curves, label = (
            _curves(rules, "samples, mean", "coverage"),
            "fraction of 95 % intervals with the truth",
        )
        axes = draw_curves(figure, curves, spent, label, scales=("log", "linear"))
        axes.axhline(0.95, color="0.5", linewidth=0.8)

    return (
        Drawing("ensemble_error", sentences.paragraph("error_caption"), error),
        Drawing("ensemble_belief", sentences.paragraph("belief_caption"), belief),
        Drawing("ensemble_coverage", sentences.paragraph("coverage_caption"), coverage),
    )


def _curves(frame: "pd.DataFrame", cost: str, error: str = "rms error") -> list[Curve]:
    """Return the curve of each rule, of its errors or of its coverage, with 95 % bands."""
    spread = 1.96 * frame["coverage, standard error"]
    low, high = frame["coverage"] - spread, np.minimum(frame["coverage"] + spread, 1.0)
    wide = frame.assign(**{"coverage, low": low, "coverage, high": high})
    return [
        Curve(str(rule), rows[cost], rows[error], rows[f"{error}, low"], rows[f"{error}, high"])
        for rule, rows in wide.groupby("rule", sort=False)
    ]


RULE_COLUMNS: Final = (
    Column("rule", text=True),
    Column("tolerance", "TOL", format=".3g"),
    Column("error believed", "believed", format=".1e"),
    RowColumn(
        "samples, mean (10 %, 90 %)",
        format=lambda row: (
            f"{row['samples, mean']:.0f} ({row['samples, 10 %']:.0f}, {row['samples, 90 %']:.0f})"
        ),
    ),
    Column("rms error", format=format_percent),
    Column("median error", format=format_percent),
    RowColumn("by luck", format=lambda row: _share(row, "stopped by luck")),
    RowColumn("95 % covers", format=lambda row: _share(row, "coverage")),
    Column("ended at max_samples", "at max_samples", format=format_percent),
)


def _tables(frame: "pd.DataFrame", goal: float, sentences: Sentences) -> tuple[Table, ...]:
    import pandas as pd

    chosen = pd.concat([at_goal(of_rules(frame), goal), frame[frame["rule"] == OWN]])
    everything = "Every rule at every tolerance; errors are relative, samples are counts."
    caption = sentences.paragraph("table_caption")
    return (
        frame_table(chosen, caption, "ensemble_at_goal", RULE_COLUMNS),
        frame_table(frame, everything, "ensemble_rules"),
    )
