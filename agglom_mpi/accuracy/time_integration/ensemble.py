"""How many samples does a string need, and do intervals hold where stopping rules end them?"""

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
from agglom_mpi.accuracy.time_integration.steps import EVENT, StudiedScene, cost_at
from agglom_mpi.accuracy.time_integration.stopping_study import (
    OWN,
    Truth,
    at_goal,
    families,
    of_rules,
    round_goal,
    study,
)
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_percent
from agglom_mpi.random_streams import search_stream
from agglom_mpi.report.style import Drawing
from agglom_mpi.search.objectives.growth import MaximumGrowth
from agglom_mpi.search.objectives.objective import RadiusObjective

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

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
        return ensemble_section(scene.campaign, samples[EVENT], scene.quick)

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
    values: dict[str, Any] = {"rows": len(rows), "pool": len(pool), "costs": [], "flaws": []}
    plan, objective = campaign.plan, campaign.objective
    if values.setdefault("other_objective", not isinstance(objective, RadiusObjective)):
        plan, objective = None, MaximumGrowth().of_grains(campaign.scene.equivalent_grains)
    assert isinstance(objective, RadiusObjective)
    title = "Ensemble: how many samples, and when to stop"
    too_few = len(pool) < FEWEST_ROWS
    truth = None if too_few else Truth.of_pool(pool, objective)
    if truth is None or truth.spread <= ROUNDING * truth.mean:
        return Sentences("ensemble", **values, fewest=FEWEST_ROWS, most=0).section(title)
    most = min(max(plan.ensemble.max_samples, SHORTEST), LONGEST) if plan else SHORTEST
    orders = min(QUICK_ORDERS if quick else ORDERS, MOST_DRAWS // most)
    draws = search_stream(campaign.seed, RANDOM_ORDER).integers(0, len(pool), (most, orders))
    rules = families(truth, most)
    if plan and plan.ensemble.is_adaptive:
        rules.append((OWN, plan.ensemble))
    frame, goal = study(pool, objective, rules, draws), round_goal(truth)
    values |= {"truth": truth, "orders": orders, "most": most, "own": plan and plan.ensemble}
    values |= {"goal": goal, "costs": list(_costs(of_rules(frame), goal)), "coverage": _coverage}
    values |= {"flaws": list(_flaws(frame)), "failed": len(rows) - len(pool)}
    own_rows = frame[frame["rule"] == OWN]
    sentences = Sentences("ensemble", **values, own_rows=own_rows.to_dict("records"))
    return sentences.section(
        title, _figures(frame, truth, most, sentences), _tables(frame, goal, sentences)
    )


def _coverage(row: Any) -> str:
    return f"{100.0 * row['coverage']:.1f} ± {100.0 * row['coverage, standard error']:.1f} %"


def _costs(rules: "pd.DataFrame", goal: float) -> Iterator[dict[str, Any]]:
    """Yield the mean samples that each rule takes to a relative error, inf where it does not."""
    for rule, rows in rules.groupby("rule", sort=False):
        samples = cost_at(rows["rms error"], rows["samples, mean"], goal)
        yield {"rule": rule, "samples": samples, "best": rows["rms error"].min()}


def _flaws(frame: "pd.DataFrame") -> Iterator[dict[str, Any]]:
    """Yield for each rule where its intervals cover too little, and where it does not stop."""
    for rule, rows in frame.groupby("rule", sort=False):
        # Four standard errors are more than chance.
        short = rows[rows["coverage"] < 0.95 - 4.0 * rows["coverage, standard error"]]
        worst = None if short.empty else short.sort_values("coverage").iloc[0]
        endless = rows[rows["ended at max_samples"] > 0.5]
        yield {"name": rule, "short": short, "worst": worst, "endless": endless}


def _figures(
    frame: "pd.DataFrame", truth: Truth, most: int, sentences: Sentences
) -> tuple[Drawing, ...]:
    spent, spread = "samples spent (mean)", 1.96 * frame["coverage, standard error"]
    low, high = frame["coverage"] - spread, np.minimum(frame["coverage"] + spread, 1.0)
    rules = of_rules(frame.assign(**{"coverage, low": low, "coverage, high": high}))

    def curves(column: str) -> list[Curve]:
        names = "samples, mean", column, f"{column}, low", f"{column}, high"
        groups = rules.groupby("rule", sort=False)
        return [Curve(str(rule), *(rows[name] for name in names)) for rule, rows in groups]

    def error(figure: "matplotlib.figure.Figure") -> None:
        axes = draw_curves(figure, curves("rms error"), spent, "rms relative error of mean b/b⁰")
        count = np.geomspace(2.0, most)
        best = truth.spread / truth.mean / np.sqrt(count)
        axes.plot(count, best, "k--", linewidth=1.0, label="number fixed beforehand")
        axes.legend()

    def coverage(figure: "matplotlib.figure.Figure") -> None:
        label = "fraction of 95 % intervals with the truth"
        axes = draw_curves(figure, curves("coverage"), spent, label, scales=("log", "linear"))
        axes.axhline(0.95, color="0.5", linewidth=0.8)

    return (
        Drawing("ensemble_error", sentences.paragraph("error_caption"), error),
        Drawing("ensemble_coverage", sentences.paragraph("coverage_caption"), coverage),
    )


RULE_COLUMNS: Final = (
    Column("rule", text=True),
    Column("tolerance", "TOL", format=".3g"),
    Column("samples, mean", format=".0f"),
    Column("rms error", format=format_percent),
    RowColumn("95 % covers", format=_coverage),
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
