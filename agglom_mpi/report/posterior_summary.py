"""Posteriors of a campaign as text: of a measured mean, and of all its data."""

from typing import Final

import numpy as np
from rich.console import Group, RenderableType

from agglom_mpi.display.fitted_table import FittedTable, LabelledTexts
from agglom_mpi.formatting import format_digits, in_unit
from agglom_mpi.inference.measured_mean import MeasuredMean
from agglom_mpi.inference.nearest import quantity_name
from agglom_mpi.inference.posterior import Posterior
from agglom_mpi.inference.posterior_sampling import CENTRAL
from agglom_mpi.inference.predictive import PredictedDatum
from agglom_mpi.inference.searched_box import SearchedBox

SHOWN_PAIRS: Final = 6
"""Number of pairs of variables whose correlations are shown."""


def percent(share: float, digits: int = 3) -> str:
    """Return a share as a text in percent."""
    return f"{format_digits(100.0 * share, digits)} %"


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
    facts = LabelledTexts()
    facts.add_row("prior", measure_text(posterior.of.box))
    facts.add_row("strings", _size(posterior))
    share = percent(posterior.volume)
    facts.add_row("share of the box", f"{share} has 90 % of the posterior")
    if posterior.calibration is not None:
        facts.add_row("check", posterior.calibration.text)
    lines: list[RenderableType] = [f"posterior, given {posterior.given}", facts]
    if posterior.warning:
        lines.append(f"warning: {posterior.warning}")
    lines += _tables(posterior)
    lines.append(_data_table(posterior))
    if len(posterior.predictions) > 1:
        lines.append(f"all data together: p = {posterior.p_value:.2g}")
    return Group(*lines)


def _size(posterior: Posterior) -> str:
    return (
        f"effective size {posterior.effective_size:,.0f} of {len(posterior.weights):,} "
        f"({posterior.method})"
    )


def _tables(posterior: Posterior) -> list[RenderableType]:
    """Return the table of the variables, and that of their correlations."""
    headings = ("2.5 %", "25 %", "50 %", "75 %", "97.5 %", "width of prior's")
    table = FittedTable("variable", *headings)
    for each in posterior.of.box.own:
        quantiles = (f"{value:.4g}" for value in posterior.quantiles(each.name))
        width = f"{100.0 * posterior.contraction[each.name]:.0f} %"
        table.add_row(in_unit(each.name, each.unit), *quantiles, width)
    several = len(posterior.of.box.names) > 1
    return [table, _correlation_table(posterior)] if several else [table]


def _correlation_table(posterior: Posterior) -> FittedTable:
    """Return a table of the pairs with the largest partial correlations."""
    names = posterior.of.box.names
    plain, partial = posterior.correlations, posterior.partial_correlations
    pairs = [(i, j) for i in range(len(names)) for j in range(i)]
    pairs.sort(key=lambda pair: -abs(partial[pair]))
    table = FittedTable("correlation", "all free", "others kept")
    for i, j in pairs[:SHOWN_PAIRS]:
        table.add_row(f"{names[j]}, {names[i]}", f"{plain[i, j]:+.2f}", f"{partial[i, j]:+.2f}")
    return table


def _data_table(posterior: Posterior) -> FittedTable:
    """Return a table of the data, what the posterior predicts for them, and which disagree."""
    table = FittedTable("datum", "measured", "predicted, 90 %", "p", "", left=(0, 4))
    for each in posterior.predictions:
        table.add_row(each.datum.name, *_compared(each), f"{each.p_value:.2g}", each.verdict)
    return table


def _compared(predicted: PredictedDatum) -> tuple[str, str]:
    """Return a measured number and its prediction in SI units; for shares how many there are."""
    datum = predicted.datum
    if len(datum.values) > 1:
        return f"{len(datum.values)} shares", "see the curve"
    low, high = predicted.quantiles(CENTRAL)[:, 0]
    error = float(np.sqrt(datum.covariance[0, 0]))
    digits = max(3, int(np.ceil(np.log10(abs(datum.values[0]) / error))) + 2) if error else 6
    shown = (format_digits(float(value), digits) for value in (low, high))
    return f"{datum.values[0]:.{digits}g} ± {error:.2g}", " to ".join(shown)
