"""Posteriors of a campaign as text: of a measured mean, and of all its data."""

from typing import Any, Final

import numpy as np
from rich.console import Group, RenderableType

from agglom_mpi.analysis.shown_units import shown_unit, unit_of_datum
from agglom_mpi.display.table import Column, Facts, Table
from agglom_mpi.formatting import axis_label, format_digits, format_percent, in_unit, label_of
from agglom_mpi.inference.measured_mean import MeasuredMean
from agglom_mpi.inference.posterior import Posterior
from agglom_mpi.inference.posterior_sampling import CENTRAL, REPORTED_QUANTILES
from agglom_mpi.inference.predictive import PredictedDatum
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.set_points import quantity_name

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
    """Return the posterior of a measured mean as text and tables."""
    of = posterior.of
    assert isinstance(of, MeasuredMean)
    quantity, measured = quantity_name(of.quantity), f"{of.measured:g} ± {of.error:g}"
    lines: list[RenderableType] = [
        f"posterior, given a measured {quantity} of {measured}",
        f"prior {measure_text(of.box)}; {_size(posterior)}",
        *_tables(posterior),
    ]
    if posterior.warning:
        lines.append(f"warning: {posterior.warning}")
    return Group(*lines)


def data_posterior_text(posterior: Posterior) -> RenderableType:
    """Return the posterior of all data as text and tables; its verdict stands above the numbers."""
    share = format_percent(posterior.volume, 3)
    facts = [
        ("prior", measure_text(posterior.of.box)),
        ("strings", _size(posterior)),
        ("share of the box", f"{share} has 90 % of the posterior"),
    ]
    if posterior.calibration is not None:
        facts.append(("check", posterior.calibration.text))
    lines: list[RenderableType] = [f"posterior, given {posterior.given}", Facts(facts)]
    if posterior.warning:
        lines.append(f"warning: {posterior.warning}")
    rows = [_compared(each, posterior.of.box.campaign.text) for each in posterior.predictions]
    lines += [*_tables(posterior), Table(DATA_COLUMNS, rows)]
    if len(posterior.predictions) > 1:
        lines.append(f"all data together: p = {posterior.p_value:.2g}")
    return Group(*lines)


def _size(posterior: Posterior) -> str:
    return (
        f"effective size {posterior.effective_size:,.0f} of {len(posterior.weights):,} "
        f"({posterior.method})"
    )


def _tables(posterior: Posterior) -> list[RenderableType]:
    """Return the table of the variables, and that of the largest partial correlations."""
    rows, text = [], posterior.of.box.campaign.text
    for each in posterior.of.box.own:
        factor, unit = shown_unit(text, each.name, each.unit, each.upper)
        quantiles = (value / factor for value in posterior.quantiles(each.name))
        row = {"variable": axis_label(each.name, unit), "width": posterior.contraction[each.name]}
        rows.append(row | dict(zip(map(str, REPORTED_QUANTILES), quantiles, strict=True)))
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


def _compared(predicted: PredictedDatum, text: str) -> dict[str, Any]:
    """Return the row of a datum: measured and predicted number, or how many shares there are."""
    datum = predicted.datum
    row = {"datum": datum.name, "p": predicted.p_value, "verdict": predicted.verdict}
    if len(datum.values) > 1:
        return row | {"measured": f"{len(datum.values)} shares", "predicted": "see the curve"}
    factor, unit = unit_of_datum(text, datum)
    low, high = predicted.quantiles(CENTRAL)[:, 0] / factor
    value, error = datum.values[0] / factor, float(np.sqrt(datum.covariance[0, 0])) / factor
    digits = max(3, int(np.ceil(np.log10(abs(value) / error))) + 2) if error else 6
    shown = " to ".join(format_digits(float(end), digits) for end in (low, high))
    measured = f"{value:.{digits}g} ± {error:.2g}"
    return row | {"measured": in_unit(measured, unit), "predicted": in_unit(shown, unit)}
