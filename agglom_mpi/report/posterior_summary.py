"""Posteriors of a campaign, what to measure next, and laws compared, as text."""

import math
from collections.abc import Callable, Iterable
from typing import Any, Final

import numpy as np
from rich.console import Group, RenderableType

from agglom_mpi.analysis.shown_units import shown_unit, unit_of_datum, unit_of_variable
from agglom_mpi.display.table import Column, Facts, Table
from agglom_mpi.formatting import (
    axis_label,
    format_digits,
    format_percent,
    in_unit,
    label_of,
    pluralise,
    value_with_error,
)
from agglom_mpi.inference.contributions import PredictedDatum
from agglom_mpi.inference.data_posterior import MeasuredMean
from agglom_mpi.inference.law_comparison import MAX_PARETO, LawComparison
from agglom_mpi.inference.next_measurement import NextMeasurements
from agglom_mpi.inference.posterior import Posterior
from agglom_mpi.inference.posterior_sampling import CENTRAL, REPORTED_QUANTILES
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.set_points import quantity_name
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.statistics import gap_between, weighted_quantiles
from agglom_mpi.variables import Variable

SHOWN_PAIRS: Final = 6
"""Number of pairs of variables whose correlations are shown."""
MIN_BRANCH: Final = 0.02
"""Minimum share of the posterior of a branch that is named."""


def measure_text(box: SearchedBox) -> str:
    """Return the measure of shares and volumes: uniform in the coordinates of the search."""
    kinds = {
        "log({})": [each.name for each in box.own if each.logarithmic],
        "the cube of {}": [each.name for each in box.own if each.cubic],
    }
    other = [name for name in box.names if not any(name in some for some in kinds.values())]
    parts = [kind.format(name) for kind, some in kinds.items() for name in some]
    if not parts:
        return "uniform in every variable"
    rest = ", linear in the other variables" if other else ""
    return f"uniform in {', '.join(parts)}{rest}"


def posterior_text(posterior: Posterior) -> RenderableType:
    """Return the posterior of a measured mean, or of all data, as text and tables.

    The verdict on the posterior of data stands above its numbers.
    """
    of, size = (
        posterior.of,
        (
            f"effective size {posterior.effective_size:,.0f} of {len(posterior.weights):,} "
            f"({posterior.method})"
        ),
    )
    warning = [f"warning: {posterior.warning}"] if posterior.warning else []
    if isinstance(of, MeasuredMean):
        quantity, measured = quantity_name(of.quantity), f"{of.measured:g} ± {of.error:g}"
        return Group(
            f"posterior, given a measured {quantity} of {measured}",
            f"prior {measure_text(of.box)}; {size}",
            *_tables(posterior),
            *warning,
        )
    share = format_percent(posterior.volume, 3)
    facts = [
        ("prior", measure_text(of.box)),
        ("strings", size),
        ("share of the box", f"{share} has 90 % of the posterior"),
    ]
    if branches := _branches(posterior):
        facts.append(("branches", "\n".join(branches)))
    if posterior.calibration is not None:
        facts.append(("check", posterior.calibration.text))
    rows = [_compared(each, of.box.campaign.text) for each in posterior.predictions]
    data = [*_tables(posterior), Table(DATA_COLUMNS, rows), *_contributions(posterior)]
    if len(rows) > 1:
        data.append(f"all data together: p = {posterior.p_value:.2g}")
    return Group(f"posterior, given {posterior.given}", Facts(facts), *warning, *data)


def _branches(posterior: Posterior) -> list[str]:
    """Return a line for each variable whose posterior is in two groups that are apart."""
    found = []
    for variable in posterior.of.box.own:
        values = variable.values(posterior.strings)
        scaled = np.log(values) if variable.logarithmic else values
        if (gap := gap_between(scaled, posterior.weights)) is None:
            continue
        lower = scaled < gap
        share = float(posterior.weights[lower].sum())
        if MIN_BRANCH <= share <= 1.0 - MIN_BRANCH:
            factor, unit = unit_of_variable(posterior.of.box.campaign.text, variable)
            ends = [
                weighted_quantiles(values[part], posterior.weights[part], (end,))[0]
                for part, end in ((lower, 0.99), (~lower, 0.01))
            ]
            below, above = (in_unit(f"{end / factor:.3g}", unit) for end in ends)
            found.append(
                f"{label_of(variable.name)}: {format_percent(share)} up to {below}, "
                f"{format_percent(1.0 - share)} from {above} on"
            )
    return found


def variable_rows(
    text: str, variables: Iterable[Any], cells: Callable[[Any, float], dict[str, Any]]
) -> list[dict[str, Any]]:
    """Return a row for each searched variable with its range, in the unit that a campaign writes.

    `cells` makes more cells of a variable and the factor of its unit.
    """
    rows = []
    for each in variables:
        factor, unit = unit_of_variable(text, each)
        searched = f"{each.lower / factor:.4g} to {each.upper / factor:.4g}"
        row = {"variable": axis_label(each.name, unit), "searched": searched}
        rows.append(row | cells(each, factor))
    return rows


def _tables(posterior: Posterior) -> list[Any]:
    """Return the table of the variables, and that of the largest partial correlations."""

    def cells(variable: Variable, factor: float) -> dict[str, Any]:
        quantiles = zip(REPORTED_QUANTILES, posterior.quantiles(variable.name), strict=True)
        row = {str(share): value / factor for share, value in quantiles}
        return row | {"width": posterior.contraction[variable.name]}

    rows = variable_rows(posterior.of.box.campaign.text, posterior.of.box.own, cells)
    names = [label_of(name) for name in posterior.of.box.names]
    plain, partial = posterior.correlations, posterior.partial_correlations
    pairs = [(i, j) for i in range(len(names)) for j in range(i)]
    pairs.sort(key=lambda pair: -abs(partial[pair]))
    correlations = [
        {"pair": f"{names[j]}, {names[i]}", "plain": plain[i, j], "partial": partial[i, j]}
        for i, j in pairs[:SHOWN_PAIRS]
    ]
    tables = [Table(VARIABLE_COLUMNS, rows), Table(CORRELATION_COLUMNS, correlations)]
    return [table for table in tables if table.rows]


VARIABLE_COLUMNS: Final = (
    Column("variable"),
    *(Column(str(share), f"{100.0 * share:g} %", format=".4g") for share in REPORTED_QUANTILES),
    Column("width", "width of prior's", format=lambda share: f"{100.0 * share:.0f} %"),
)
CORRELATION_COLUMNS: Final = (
    Column("pair", "correlation"),
    Column("plain", "all free", format="+.2f"),
    Column("partial", "others kept", format="+.2f"),
)
DATA_COLUMNS: Final = (
    Column("datum"),
    Column("measured"),
    Column("predicted", "predicted, 90 %"),
    Column("p", format=".2g"),
    Column("verdict", "", text=True),
)


def _contributions(posterior: Posterior) -> list[Any]:
    """Return the table of what each experiment contributes to each variable; none of one alone."""
    if not posterior.contributions:
        return []
    names = posterior.of.box.names
    share = lambda part: f"{100.0 * part:.3g} %"  # noqa: E731
    columns = (
        Column("data", "width of prior's, given"),
        *(Column(name, label_of(name), format=share) for name in names),
        Column("volume", "share of the box", format=share),
    )
    rows = [
        {"data": each.label, "volume": each.volume, **each.contraction}
        for each in posterior.contributions
    ]
    return [Table(columns, rows)]


def _compared(predicted: PredictedDatum, text: str) -> dict[str, Any]:
    """Return the row of a datum: measured and predicted number, or how many shares there are."""
    datum = predicted.datum
    row = {"datum": datum.name, "p": predicted.p_value, "verdict": predicted.verdict}
    if len(datum.values) > 1:
        measured = pluralise(len(datum.values), datum.kind.one_value)
        return row | {"measured": measured, "predicted": "see the curve"}
    factor, unit = (1.0, "1") if datum.kind.is_exact else unit_of_datum(text, datum)
    low, high = predicted.quantiles(CENTRAL)[:, 0] / factor
    value, error = datum.values[0] / factor, float(np.sqrt(datum.covariance[0, 0])) / factor
    digits = max(3, int(np.ceil(np.log10(abs(value) / error))) + 2) if error else 6
    shown = " to ".join(format_digits(float(end), digits) for end in (low, high))
    measured = f"{value:.{digits}g} ± {error:.2g}"
    return row | {"measured": in_unit(measured, unit), "predicted": in_unit(shown, unit)}


MAX_MEASUREMENTS: Final = 12
"""Maximum number of measurements in the table of the terminal."""


def next_text(found: NextMeasurements, text: str) -> RenderableType:
    """Return the measurements that leave least of the box as a table, in units of the campaign."""
    volume = format_digits(100.0 * found.volume, 3)
    heading = (
        f"what to measure next: 90 % of the posterior fill {volume} % of the box; expected share "
        "after one more measurement"
    )
    rows = [
        {
            "measurement": each.name,
            "value": value_text(each.datum, each.predicted, text),
            "error": each.error_text,
            "volume": each.volume_text,
        }
        for each in found.ranked[:MAX_MEASUREMENTS]
    ]
    left = len(found.ranked) - MAX_MEASUREMENTS
    more = [f"and {pluralise(left, 'measurement')} that would leave more"] if left > 0 else []
    return Group(heading, Table(NEXT_COLUMNS, rows), *more)


NEXT_COLUMNS: Final = (
    Column("measurement"),
    Column("value", "expected value"),
    Column("error"),
    Column("volume", "share of the box"),
)


def value_text(datum: Datum, value: float, text: str) -> str:
    """Return the value of a datum that is expected; nothing for shares of sizes."""
    if len(datum.values) > 1:
        return ""
    factor, unit = shown_unit(text, datum.quantity, datum.kind.unit, value)
    return in_unit(f"{value / factor:.4g}", unit)


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
