"""Laws compared, as text for the terminal."""

import math
from typing import Final

from rich.console import Group, RenderableType

from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import value_with_error
from agglom_mpi.inference.law_comparison import MAX_PARETO, LawComparison
from agglom_mpi.report.posterior_summary import MAX_MEASUREMENTS, value_text

LAW_COLUMNS: Final = (
    Column("law"),
    Column("probability", format=".2g"),
    Column("p_value", "p of the fit", format=".2g"),
    Column("evidence", "ln evidence"),
    Column("effective_size", format=",.0f"),
    Column("box_doubled", "box doubled"),
    Column("left_out_log_density", "data left out", format=".2f"),
)

LEAST_SHOWN: Final = 1e-3
"""Least error of a probability that is shown."""


def law_text(found: LawComparison) -> RenderableType:
    """Return the verdict on laws, their table, and what the table does not say."""
    rows = []
    for row in found.records():
        evidence = value_with_error(row["log_evidence"], row["log_evidence_error"])
        change = row["log_evidence_change_if_box_doubled"]
        doubled = f"{change:.2f}, probability {row['probability_if_box_doubled']:.2g}"
        rows.append(row | {"evidence": evidence, "box_doubled": doubled})
    return Group(found.verdict, Table(LAW_COLUMNS, rows), *_notes(found), *_next(found))


def _next(found: LawComparison) -> list[RenderableType]:
    """Return the measurements that tell the two most probable laws apart best."""
    if not found.further:
        return []
    two = [found.laws[i] for i in found.order[:2]]
    text, apart = two[0].posterior.of.box.campaign.text, found.further[0].apart
    rows = [
        {
            "measurement": each.name,
            "first": "" if each.repeats else value_text(each.datum, each.predicted, text),
            "other": "" if each.repeats else value_text(each.datum, each.other_predicted, text),
            "error": each.error_text,
            "right": value_with_error(
                1.0 - each.apart.doubt, max(each.apart.doubt_error, LEAST_SHOWN)
            ),
            "factor": each.apart.log_bayes_factor,
        }
        for each in found.further[:MAX_MEASUREMENTS]
    ]
    columns = (
        Column("measurement"),
        Column("first", f"by {two[0].name}"),
        Column("other", f"by {two[1].name}"),
        Column("error"),
        Column("right", "right law"),
        Column("factor", "ln Bayes factor", format=".2f"),
    )
    now = 1.0 - apart.doubt - apart.gain
    heading = (
        "what to measure next: expected probability of the right law of both after it, "
        f"{now:.2f} now, and expected ln of the Bayes factor for it"
    )
    return ["", heading, Table(columns, rows)]


def _notes(found: LawComparison) -> list[str]:
    notes = [
        "probability: at equal odds, if one of them is right; ln evidence: of data in units of "
        "their errors",
        f"box doubled: −{math.log(2.0):.2f} for each variable that the posterior keeps inside",
    ]
    for law in found.laws:
        if law.evidence.open_ended:
            names = ", ".join(law.evidence.open_ended)
            notes.append(f"{law.name}: what doubled ranges of {names} would change is not known")
        if not law.evidence.is_resolved:
            notes.append(f"warning: {law.name}: the effective size is too small for its evidence")
        if law.left_out is not None and law.left_out.unreliable:
            notes.append(
                f"{law.name}: densities of {law.left_out.unreliable} of "
                f"{len(law.left_out.names)} data left out are not reliable (Pareto shape above "
                f"{MAX_PARETO:g})"
            )
    if (deciding := found.deciding) is None:
        return [*notes, "data left out need ArviZ: pip install 'agglom_mpi[arviz]'"]
    first, second = (found.laws[i].name for i in found.order[:2])
    for name, apart in filter(None, (deciding, found.deciding_experiment)):
        notes.append(
            f"of the two most probable, {name} decides most: {abs(apart):.2g} in ln density for "
            f"{first if apart > 0.0 else second}"
        )
    return notes
