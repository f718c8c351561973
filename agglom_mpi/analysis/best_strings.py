"""The best strings of a campaign: their numbers, and the rows of the tables that show them.

`agglom report` shows them on the terminal (`summary`), as JSON, and on the page
(`report/page_tables`); `CampaignFile.best` is a pandas table (`tables.best`).
"""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.analysis.derived import derived_columns, values_of
from agglom_mpi.analysis.drawn_sizes import drawn_fraction
from agglom_mpi.analysis.estimates import Estimate, objective_of
from agglom_mpi.analysis.finite_size import finite_sizes
from agglom_mpi.analysis.quantity_means import as_entries
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.tables import time_of_strings
from agglom_mpi.outcome import COMPLETED, summaries
from agglom_mpi.storage.reader import CampaignData

REESTIMATED: Final = (
    "objective",
    "standard_error",
    "lower",
    "upper",
    "samples",
    "failed",
    "mean_radius_ratio",
)
"""Attributes of an `Estimate` that are shown of a string."""


class StringRow(NamedTuple):
    """A row of the tables of the best strings, which have one string a column.

    Attributes
    ----------
    key
        Key of the number in an entry of `collect_best`, or in its `reestimate`.
    style
        Format of the number.
    on_terminal, on_page
        Label of the row; empty where the row is left out.
    """

    key: str
    style: str
    on_terminal: str
    on_page: str = ""


OBJECTIVE_ROWS: Final = (
    StringRow("objective", ".4f", "objective, as searched", "objective, as searched"),
    StringRow("standard_error", ".4f", "± standard error"),  # the page joins it to the objective
)
"""Rows on the objective, of the samples that a string was chosen by."""
FRESH_ROWS: Final = (
    StringRow("objective", ".4f", "re-estimate", "objective, re-estimate"),
    StringRow("lower", ".4f", "95 % from", "95 % from"),
    StringRow("upper", ".4f", "95 % to", "95 % to"),
    StringRow("mean_radius_ratio", ".4g", "mean b/b0, re-estimate", "mean b/b⁰, re-estimate"),
    StringRow("samples", "d", "fresh samples", "fresh samples"),
)
"""Rows on the `reestimate`, of fresh samples."""
LIMIT_ROWS: Final = (
    StringRow("limit", ".4g", "mean b/b0, many grains", "mean b/b⁰ for many grains"),
    StringRow("limit_standard_error", ".2g", "± standard error", "± standard error"),
    StringRow("shift", ".2g", "  shift by finite size", "shift by finite size"),
    StringRow("shift_standard_error", ".2g", "  ± standard error", "± standard error"),
    StringRow("limit_objective", ".4f", "objective, many grains", "objective for many grains"),
    StringRow("limit_objective_standard_error", ".4f", "± standard error", "± standard error"),
)
"""Rows on the `finite_size`, of fresh samples in several control volumes."""
GROWTH_ROWS: Final = (
    StringRow("mean_radius_ratio", ".4g", "mean b/b0, as searched", "mean b/b⁰, as searched"),
    StringRow("growth_number", ".4g", "  (mean b/b0)^3", "(mean b/b⁰)³, as searched"),
    StringRow("mean_grains", ".4g", "  grains per particle", "grains per particle, as searched"),
    StringRow("samples", "d", "  samples", "samples used"),
)
"""Rows on the growth, of the samples that a string was chosen by."""


def time_row(best: Sequence[dict[str, Any]]) -> StringRow:
    """Return the row on the time of strings: on a processor, if that was recorded of all."""
    if all(math.isfinite(entry["processor_seconds"]) for entry in best):
        return StringRow("processor_seconds", ".3g", "processor s", "processor time")
    return StringRow("seconds", ".3g", "wall-clock s", "wall-clock time")


def collect_best(file: CampaignData, count: int) -> list[dict[str, Any]]:
    """Return the numbers of the best strings, an entry each, the best first.

    Each has a `reestimate` on its fresh samples, None if it has none.
    """
    rows, estimates, order = rank_strings(file)
    again = {estimate.string: estimate for estimate in estimates}
    parameters = {int(row["string"]): row for row in file.string_rows()}
    samples, room = file.all_sample_rows(), max(parameters, default=-1) + 1
    wall, cpu = (time_of_strings(samples, room, name) for name in ("seconds", "cpu_seconds"))
    return [
        _entry(file, rows[string], parameters[string], again.get(string))
        | {"seconds": float(wall[string]), "processor_seconds": float(cpu[string])}
        | _filled(file, string)
        | ({"quantities": as_entries(file, string)} if file.sizes.quantities else {})
        | _finite_size(file, string)
        | {
            column.name: float(values_of(file, [string], column.name)[0])
            for column in derived_columns(file)
        }
        for string in order[:count]
    ]


def _entry(
    file: CampaignData, result: np.void, string: np.void, again: Estimate | None
) -> dict[str, Any]:
    """Return the numbers of a string: as searched, and under `reestimate` on fresh samples."""
    number = int(result["string"])
    entry: dict[str, Any] = {"string": number}
    for name in file.variables.names:
        if not np.isnan(string[name]):
            entry[name] = float(string[name])
    for name in ("objective", "standard_error", "mean_radius_ratio", "growth_number"):
        entry[name] = float(result[name])
    entry["mean_grains"] = float(result["mean_grains"])
    entry["samples"] = int(result["samples_used"])
    entry["reestimate"] = again and {name: getattr(again, name) for name in REESTIMATED}
    rows = file.all_sample_rows()
    rows = rows[(rows["string"] == number) & (rows["state"] == COMPLETED)]
    entry |= reached_moments(file, rows[rows["sample"] < file.samples_used.get(number, 0)])
    if again is not None:
        entry["reestimate"] |= reached_moments(file, rows[rows["sample"] >= file.fresh_from])
    return entry


def reached_moments(file: CampaignData, rows: np.ndarray) -> dict[str, Any]:
    """Return the `moments` that have a target of their own, of completed samples.

    Empty where the objective has none, so that other entries are as ever.
    """
    law = objective_of(file)
    if not law.has_moments:
        return {}
    return {"moments": {moment.name: moment.as_dict() for moment in law.reached(summaries(rows))}}


def _finite_size(file: CampaignData, string: int) -> dict[str, Any]:
    """Return the `finite_size` of a string, None without samples in several volumes.

    Empty where the file has a single volume.
    """
    if not file.volumes:
        return {}
    size = finite_sizes(file).get(string)
    return {"finite_size": None if size is None else size.as_dict()}


def _filled(file: CampaignData, string: int) -> dict[str, Any]:
    """Return the volume fraction of the grains of a string's completed samples; empty if equal."""
    drawn = drawn_fraction(file, string)
    return {} if drawn is None else {"drawn_volume_fraction": drawn.as_dict()}
