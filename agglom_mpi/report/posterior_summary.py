"""Posteriors of a campaign, and what to measure next, as text."""

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
)
from agglom_mpi.inference.contributions import PredictedDatum
from agglom_mpi.inference.data_posterior import MeasuredMean
from agglom_mpi.inference.next_measurement import NextMeasurements
from agglom_mpi.inference.posterior import Posterior
from agglom_mpi.inference.posterior_sampling import CENTRAL, REPORTED_QUANTILES
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.set_points import quantity_name
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.variables import Variable

SHOWN_PAIRS: Final = 6
"""Number of pairs of variables whose correlations are shown."""


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
    if posterior.calibration is not None:
        facts.append(("check", posterior.calibration.text))
    rows = [_compared(each, of.box.campaign.text) for each in posterior.predictions]
    data = [*_tables(posterior), Table(DATA_COLUMNS, rows), *_contributions(posterior)]
    if len(rows) > 1:
        data.append(f"all data together: p = {posterior.p_value:.2g}")
    return Group(f"posterior, given {posterior.given}", Facts(facts), *warning, *data)


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
