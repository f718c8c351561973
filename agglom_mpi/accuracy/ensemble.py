"""How many samples does a string need, and does a stopping rule know when it has them?"""

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
from agglom_mpi.accuracy.stopping_study import (
    OWN,
    WITH_ERROR,
    Truth,
    at_goal,
    campaigns_own,
    covers_too_little,
    families,
    of_rules,
    round_goal,
    samples_needed,
    study,
    truth_of,
)
from agglom_mpi.formatting import format_percent
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.random_streams import search_stream
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.search.objectives.growth import MaximumGrowth
from agglom_mpi.search.objectives.objective import RadiusObjective

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

    from agglom_mpi.config.campaign import Campaign

TITLE: Final = "Ensemble: how many samples, and when to stop"

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


def ensemble_section(campaign: "Campaign", rows: np.ndarray, quick: bool = False) -> ReportSection:
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
    pool = rows[rows["state"] == COMPLETED]
    sentences = Sentences("ensemble", rows=len(rows), pool=len(pool), fewest=FEWEST_ROWS)
    if len(pool) < FEWEST_ROWS:
        too_few = sentences.paragraph("too_few")
        return _nothing(sentences, "no pool to draw from", failures=(too_few,))
    plan, objective, other = campaign.plan, campaign.objective, False
    if not isinstance(objective, RadiusObjective):
        greatest = MaximumGrowth().of_grains(campaign.scene.equivalent_grains)
        plan, objective, other = None, greatest, True
    truth = truth_of(pool, objective)
    most = min(max(plan.ensemble.max_samples, SHORTEST), LONGEST) if plan else SHORTEST
    reference = sentences.paragraph("reference", truth=truth)
    if truth.spread <= ROUNDING * truth.mean:
        equal = sentences.paragraph("all_equal")
        return _nothing(sentences, reference, conclusions=(equal,))
    orders = min(QUICK_ORDERS if quick else ORDERS, MOST_DRAWS // most)
    draws = search_stream(campaign.seed, RANDOM_ORDER).integers(0, len(pool), (most, orders))
    rules = families(truth, most)
    if plan and plan.ensemble.is_adaptive:
        rules.append(campaigns_own(plan.ensemble, most))
    frame = study(pool, objective, rules, draws)
    goal = round_goal(truth)
    return sentences.section(
        TITLE,
        _figures(frame, truth, most, sentences),
        _tables(frame, goal, sentences),
        truth=truth,
        orders=orders,
        most=most,
        failed=len(rows) - len(pool),
        own=plan and plan.ensemble,
        other_objective=other,
        share=_share,
        flaws=list(_flaws(frame)),
        **_findings(frame, truth, goal),
    )


def _nothing(
    sentences: Sentences,
    reference: str,
    failures: tuple[str, ...] = (),
    conclusions: tuple[str, ...] = (),
) -> ReportSection:
    """Return a section without figures and tables."""
    problem, setups = sentences.paragraph("problem"), "nothing was run"
    return ReportSection(TITLE, problem, reference, setups, (), (), failures, conclusions)


def _share(row: Any, name: str) -> str:
    """Return a proportion and its standard error in percent, from the columns of a row."""
    if math.isnan(row[name]):
        return "–"
    return f"{100.0 * row[name]:.1f} ± {100.0 * row[f'{name}, standard error']:.1f} %"


def _findings(frame: "pd.DataFrame", truth: Truth, goal: float) -> dict[str, Any]:
    """Return what the conclusions refer to."""
    rules = of_rules(frame)
    with_error = rules[rules["rule"] == WITH_ERROR]
    return {
        "goal": goal,
        "samples_at_goal": (truth.spread / truth.mean / goal) ** 2,
        "costs": list(_costs(rules, goal)),
        "with_error": None if with_error.empty else at_goal(with_error, goal).iloc[0],
        "own_rows": [row for _, row in frame[frame["rule"] == OWN].iterrows()],
    }


def _costs(rules: "pd.DataFrame", goal: float) -> Iterator[dict[str, Any]]:
    """Yield the mean samples that each rule takes to reach the goal, and its least error."""
    for rule, rows in rules.groupby("rule", sort=False):
        samples = samples_needed(rows, goal)
        yield {
            "rule": rule,
            "reached": math.isfinite(samples),
            "samples": samples,
            "best": rows["rms error"].min(),
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
        Drawing("ensemble_error", sentences.paragraph("error_caption"), error),
        Drawing("ensemble_belief", sentences.paragraph("belief_caption"), belief),
        Drawing("ensemble_coverage", sentences.paragraph("coverage_caption"), coverage),
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


COLUMNS: Final = (
    TableColumn("rule", lambda row: row["rule"]),
    TableColumn.number("tolerance", ".3g", "TOL"),
    TableColumn.number("error believed", ".1e", "believed"),
    TableColumn(
        "samples, mean (10 %, 90 %)",
        lambda row: (
            f"{row['samples, mean']:.0f} ({row['samples, 10 %']:.0f}, {row['samples, 90 %']:.0f})"
        ),
    ),
    TableColumn("rms error", lambda row: format_percent(row["rms error"])),
    TableColumn("median error", lambda row: format_percent(row["median error"])),
    TableColumn("by luck", lambda row: _share(row, "stopped by luck")),
    TableColumn("95 % covers", lambda row: _share(row, "coverage")),
    TableColumn("at max_samples", lambda row: format_percent(row["ended at max_samples"])),
)


def _tables(frame: "pd.DataFrame", goal: float, sentences: Sentences) -> tuple[ReportTable, ...]:
    import pandas as pd

    chosen = pd.concat([at_goal(of_rules(frame), goal), frame[frame["rule"] == OWN]])
    caption = sentences.paragraph("table_caption", goal=goal)
    everything = "Every rule at every tolerance; errors are relative, samples are counts."
    return (
        ReportTable("ensemble_at_goal", caption, chosen, COLUMNS),
        ReportTable("ensemble_rules", everything, frame),
    )
