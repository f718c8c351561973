"""Sections on the question and its answer: warnings, strings, what is inferred, ranges."""

from collections.abc import Iterator
from typing import Any, Final

from agglom_mpi.analysis.best_strings import best_table, collect_best
from agglom_mpi.analysis.completeness import damage_lines
from agglom_mpi.analysis.derived import (
    recorded_box,
    recorded_inversion,
    searched_variables,
    values_of,
)
from agglom_mpi.analysis.estimates import not_converged
from agglom_mpi.analysis.failed_samples import failure_lines, no_result
from agglom_mpi.analysis.ranking import listed_strings, places_by, rank_strings
from agglom_mpi.analysis.run_warnings import run_warnings
from agglom_mpi.analysis.shown_units import column_of, unit_of_variable
from agglom_mpi.analysis.summary import describe_best
from agglom_mpi.config.searchable import check_searchable
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import label_of, pluralise, value_with_error
from agglom_mpi.report.posterior_summary import next_text, posterior_text
from agglom_mpi.report.sections.section import Block, Page, bullets, note, section, shown, warning
from agglom_mpi.report.set_summary import set_text
from agglom_mpi.storage.reader import CampaignData

QUESTION: Final = ("objective", "target", "final answer")
"""Lines on a run that stand at the top of the page."""
MAX_ROWS: Final = 2000
"""Maximum number of judged strings that are listed."""


def all_warnings(file: CampaignData) -> list[str]:
    """Return a line on each thing that the terminal warns of, when a run begins and at its end."""
    campaign = recorded_inversion(file)
    before = [] if campaign is None else [*campaign.warnings(), *check_searchable(campaign)]
    return [
        *(f"{name} is altered in the file" for name in file.altered),
        *damage_lines(file),
        *failure_lines(file)[:1],
        *not_converged(file),
        *run_warnings(file),
        *map(str, before),
    ]


@section(0, "Warnings")
def warnings(page: Page) -> Iterator[Block | Table]:
    """Yield what the terminal warns of."""
    for line in all_warnings(page.data):
        yield warning(line)


@section(1, "Question")
def question(page: Page) -> Iterator[Block | Table]:
    """Yield the objective."""
    try:
        pairs = [line.partition(": ") for line in page.described[0][1]]
    except CampaignError:
        pairs = []
    asked = [(name, text) for name, _, text in pairs if name in QUESTION]
    yield Block("pairs", asked)


@section(2, "Best strings")
def answer(page: Page) -> Iterator[Block | Table]:
    """Yield the best strings, and what is known of their order."""
    data = page.data
    order = rank_strings(data).order
    if order:
        yield best_table(data, collect_best(data, listed_strings(data)))
        lines = describe_best(data, order[: listed_strings(data)])
        yield bullets([*lines, *data.unused_notes])
    elif missing := no_result(data):
        yield warning(f"{missing[0].upper()}{missing[1:]}.")
    elif len(data.result_rows()):
        yield note("The rows of all judged strings are damaged.")
    else:
        yield note("No string is judged yet.")
    yield page.figures("answer")


@section(3, "Feasible set", "set")
def feasible_set(page: Page) -> Iterator[Block | Table]:
    """Yield the feasible set, if it is asked for."""
    found = page.options.feasible_set
    if found is not None:
        yield shown(set_text(found, page.options.mean_posterior))
        yield page.figures("set")


@section(4, "Posterior of all data")
def posterior(page: Page) -> Iterator[Block | Table]:
    """Yield the posterior and what to measure next, if they are asked for."""
    found, further = page.options.posterior, page.options.further
    if found is not None:
        yield shown(posterior_text(found))
        if further is not None:
            yield shown(next_text(further, page.data.campaign_text))
        yield page.figures("posterior")


RANGE_COLUMNS: Final = (
    Column("variable"),
    Column("from", format=".6g"),
    Column("to", format=".6g"),
    Column("unit", text=True),
    Column("searched", text=True),
)


@section(5, "Ranges")
def ranges(page: Page) -> Iterator[Block | Table]:
    """Yield the variables with the ends of their ranges, the searched ones first."""
    rows, searched = [], searched_variables(page.data)
    fixed = [each for each in recorded_box(page.data).variables if each.lower == each.upper]
    for variable in (*searched, *fixed):
        how = "by its logarithm" if variable.logarithmic else "evenly"
        factor, unit = unit_of_variable(page.data.campaign_text, variable)
        row: dict[str, Any] = {"variable": label_of(variable.name), "unit": unit * (unit != "1")}
        row |= {"from": variable.lower / factor, "to": variable.upper / factor}
        rows.append(row | {"searched": how if variable in searched else "fixed"})
    yield Table(RANGE_COLUMNS, rows, name="ranges")


@section(9, "All judged strings")
def strings(page: Page) -> Iterator[Block | Table]:
    """Yield all strings that have a result."""
    if rank_strings(page.data).order:
        table = all_strings(page.data)
        yield note(describe_order(page.data))
        heading = f"{pluralise(len(table.rows), 'string')} in order of rank"
        yield Block("folded_table", table, heading)


ORDER: Final = (
    "First come the strings with a re-estimate, by it; then the last population of a search that "
    "ranks strings by more than their own samples, as it ranked them; then all others, by the "
    "objective as searched, which rests on their own samples alone."
)


def describe_order(data: CampaignData) -> str:
    """Return what strings are ordered by, and why that of the lowest objective is not the first."""
    results, _, order = rank_strings(data)
    place = min(range(len(order)), key=lambda i: results[order[i]]["objective"])
    row = results[order[place]]
    lowest = value_with_error(row["objective"], row["standard_error"])
    example = f"string {order[place]} has place {place + 1}, by {places_by(data)[place]}"
    return f"{ORDER} The lowest objective as searched is {lowest}: {example}."


def all_strings(data: CampaignData) -> Table:
    """Return the judged strings in order of rank, one a row; of many, the best `MAX_ROWS`."""
    order = rank_strings(data).order[:MAX_ROWS]
    results, again = rank_strings(data).results, rank_strings(data).estimates
    fresh = {each.string: (each.objective, each.standard_error) for each in again}
    generation = {int(row["string"]): int(row["generation"]) + 1 for row in data.string_rows()}
    variables = {
        each.name: column_of(data.campaign_text, each.name, each.unit, each.upper)
        for each in searched_variables(data)
    }
    values, by = {name: values_of(data, order, name) for name in variables}, places_by(data)
    rows: list[dict[str, Any]] = [
        {
            "rank": place + 1,
            "ranked by": by[place],
            "string": string,
            "generation": generation.get(string),
            **{name: values[name][place] for name in variables},
            "searched": (results[string]["objective"], results[string]["standard_error"]),
            "again": fresh.get(string),
            "growth": results[string]["mean_radius_ratio"],
            "samples": results[string]["samples_used"],
        }
        for place, string in enumerate(order)
    ]
    columns = [
        *(Column(name, format="d") for name in ("rank", "ranked by", "string", "generation")),
        *variables.values(),
        Column("searched", "objective, as searched"),
        Column("again", "objective, re-estimate"),
        Column("growth", "mean b/b0, as searched", format=".4g"),
        Column("samples", "samples used", format="d"),
    ]
    more = len(rank_strings(data).order) - len(order)
    caption = f"The best {len(order)} strings; {more} more have a result" if more else ""
    return Table(columns, rows, caption, "strings", anchor="string")
