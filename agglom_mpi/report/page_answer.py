"""Parts of the page on what a campaign found: the best strings, and what the paper found."""

from typing import Any, Final

from agglom_mpi.analysis.comparison import PairedSamples
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.summary import describe_bias, selection_bias
from agglom_mpi.analysis.tables import processor_seconds
from agglom_mpi.formatting import format_duration, value_with_error
from agglom_mpi.report.figures.axes import in_unit
from agglom_mpi.report.html import listed, paragraph, table
from agglom_mpi.report.published import paper_of, tables
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.variables import VARIABLES

BEST: Final = 6


def head(data: CampaignData) -> str:
    """Return what is said under the title: state and figures of the campaign."""
    status, results = data.status(), data.result_rows()
    simulated = len(data.all_sample_rows())
    state = f"{status.state}: {status.reason}" if status.reason else status.state
    counts = (
        f"{len(data.generation_rows())} generations, {len(results)} strings judged by "
        f"{int(results['samples_used'].sum())} samples of {simulated} simulated"
    )
    text = paragraph(f"{data.path.name}: {state}. {counts}.", "state")
    if status.state == "running":
        text += paragraph("The file was being written when this was made.", "warning")
    return text


def best_strings(data: CampaignData) -> str:
    """Return the table of the best strings, and what may be said of their order."""
    shown = rank_strings(data).order[:BEST]
    if not shown:
        return paragraph("No string is judged yet." if not len(data.result_rows()) else NOTHING)
    again = {estimate.string: estimate for estimate in rank_strings(data).estimates}
    rows = [*_variable_rows(data, shown), *_result_rows(data, shown)]
    if any(string in again for string in shown):
        known = [again.get(string) for string in shown]
        rows[-4:-4] = [
            _row(
                "on fresh samples", known, lambda e: value_with_error(e.objective, e.standard_error)
            ),
            _row("95 % from", known, lambda e: f"{e.lower:.4f}"),
            _row("95 % to", known, lambda e: f"{e.upper:.4f}"),
            _row("mean b/b0 (1)", known, lambda e: f"{e.mean_radius_ratio:.4g}"),
            _row("fresh samples", known, lambda e: str(e.samples)),
        ]
    headings = ["", *(f"#{place}" for place in range(1, len(shown) + 1))]
    estimated = sum(string in again for string in shown)
    paired = PairedSamples.behind(rank_strings(data).estimates, data)
    said = describe_bias(selection_bias(rank_strings(data).estimates, paired), shown, estimated)
    return table(headings, rows) + listed(said)


NOTHING: Final = "No string has a result: too many of their samples failed."


def _row(name: str, entries: list[Any], text: Any) -> list[str]:
    return [name, *("" if entry is None else text(entry) for entry in entries)]


def _variable_rows(data: CampaignData, shown: list[int]) -> list[list[str]]:
    rows = [["string", *map(str, shown)]]
    for variable, row in zip(VARIABLES, data.variable_rows(), strict=True):
        if row["lower"] == row["lower"]:  # nan: the campaign does not use it
            size, unit = in_unit(variable.unit, float(row["upper"]))
            values = data.values(shown, variable.name) / size
            fixed = "" if row["searched"] else ", fixed"
            name = f"{variable.name.replace('_', ' ')} ({unit}{fixed})"
            rows.append([name, *(f"{value:.5g}" for value in values)])
    return rows


def _result_rows(data: CampaignData, shown: list[int]) -> list[list[str]]:
    results: list[Any] = [rank_strings(data).results[string] for string in shown]
    cost = processor_seconds(data.all_sample_rows(), max(shown) + 1)
    return [
        _row(
            "objective, as searched",
            results,
            lambda r: value_with_error(float(r["objective"]), float(r["standard_error"])),
        ),
        _row("mean b/b0, as searched (1)", results, lambda r: f"{r['mean_radius_ratio']:.4g}"),
        _row("grains per particle (1)", results, lambda r: f"{r['mean_grains']:.4g}"),
        _row("samples used", results, lambda r: str(r["samples_used"])),
        ["processor time", *(format_duration(float(cost[string])) for string in shown)],
    ]


def tables_of_papers(data: CampaignData) -> tuple[str, str]:
    """Return heading and body of the part with the tables in the layout of the papers."""
    paper = paper_of(data.identity)
    if not rank_strings(data).order:
        return "Tables of the papers", paragraph("No string has a result yet.")
    fresh = "on fresh samples" if rank_strings(data).estimates else "as searched, biased low"
    if paper is None:
        note = f"This is not one of the papers' campaigns. Objectives are {fresh}."
        return "Table of the best strings", paragraph(note) + tables(data)
    note = (
        f"{paper}. The campaign asks what the paper asked (scene, objective, search box). "
        "Published rows are one run each, of a search that believes its luck and of time steps "
        "that are not exact; they are what the paper prints, not a reference. Rows of this "
        f"campaign: objectives are {fresh}."
    )
    if paper.startswith("[A]"):
        note += " The activation energy is printed in kJ/mol, with which nothing could bond."
    return "Beside the published tables", paragraph(note) + tables(data)
