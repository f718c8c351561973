"""Comparison of several campaign files."""

import json
import math
import statistics
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

from rich.console import Group, RenderableType
from rich.table import Table

from agglom_mpi.analysis.summary import Summary, as_dict, collect_summary
from agglom_mpi.formatting import format_duration
from agglom_mpi.storage.reader import CampaignData

SHOWN: Final = 12
"""Most differing settings that are listed; more are counted."""


class Comparison(NamedTuple):
    """The results of several campaign files.

    Attributes
    ----------
    summaries : list of Summary
        In the order of the files.
    differences : dict
        Settings that are not the same everywhere: name -> value in each file, None if it has none.
    comparable : bool
        Whether all have the same objective and number of grains.
    """

    summaries: list[Summary]
    differences: dict[str, list[Any]]
    comparable: bool


def compare(files: Sequence[CampaignData]) -> Comparison:
    """Compare campaign files, finished or not."""
    identities = [file.identity for file in files]
    names = dict.fromkeys(name for identity in identities for name in identity)
    differences = {}
    for name in names:
        values = [identity.get(name) for identity in identities]
        if any(value != values[0] for value in values):
            differences[name] = values
    decisive = [
        name for name in differences if name == "scene.particles" or name.startswith("objective")
    ]
    return Comparison([collect_summary(file, best=1) for file in files], differences, not decisive)


def best_objectives(comparison: Comparison) -> dict[str, list[float]]:
    """Return the objectives of the files' best strings, by the kind of samples.

    Those `as searched` are of all files that have a best string, those `re-estimated` of the files
    that estimated it again.
    """
    best = [entry for summary in comparison.summaries for entry in summary.best]
    again = [entry["reestimate"] for entry in best if entry["reestimate"]]
    return {
        "as searched": [entry["objective"] for entry in best],
        "re-estimated": [entry["objective"] for entry in again],
    }


def comparison_table(comparison: Comparison) -> RenderableType:
    """Return a table of the files, the spread of their best strings and differing settings."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("file", "state"):
        table.add_column(heading, no_wrap=True)
    for heading in ("generations", "strings", "samples", "time", "best as searched", "re-estimate"):
        table.add_column(heading, justify="right", no_wrap=True)
    for summary in comparison.summaries:
        table.add_row(*_cells(summary))
    return Group(table, "", *_footer(comparison))


def _cells(summary: Summary) -> Iterator[str]:
    samples = summary.samples_simulated + summary.samples_fresh
    yield from (summary.file, summary.state, str(summary.generations), str(summary.strings))
    yield from (str(samples), format_duration(summary.seconds))
    for entry in summary.best:
        yield _with_error(entry)
        yield _with_error(entry["reestimate"]) if entry["reestimate"] else ""


def _with_error(entry: dict[str, Any]) -> str:
    value, error = f"{entry['objective']:.4f}", entry["standard_error"]
    return value if math.isnan(error) else f"{value} ± {error:.4f}"


def _footer(comparison: Comparison) -> Iterator[str]:
    if not comparison.comparable:
        yield "objectives are not of the same question, and cannot be compared"
    else:
        for kind, values in best_objectives(comparison).items():
            if len(values) > 1:
                middle, low, high = statistics.median(values), min(values), max(values)
                yield (
                    f"best strings of {len(values)} files, {kind}: median {middle:.4f}, from "
                    f"{low:.4f} to {high:.4f}; ± is a standard error"
                )
    settings = comparison.differences
    for name, values in list(settings.items())[:SHOWN]:
        yield f"{name}: {', '.join('none' if value is None else str(value) for value in values)}"
    if len(settings) > SHOWN:
        yield f"and {len(settings) - SHOWN} more settings differ (--json has all)"
    if not settings:
        yield "all are of the same campaign, with the same seed"


def to_json(comparison: Comparison) -> str:
    """Return a comparison as JSON."""
    files = [as_dict(summary) for summary in comparison.summaries]
    more = {"differences": comparison.differences, "comparable": comparison.comparable}
    return json.dumps({"files": files, **more}, indent=2)
