"""The best strings of a campaign: their numbers, and the table of the terminal and the page.

`CampaignFile.best` is a pandas table (`tables.best`).
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from agglom_mpi.analysis.derived import derived_columns, recorded_box, values_of
from agglom_mpi.analysis.estimates import Estimate, objective_of
from agglom_mpi.analysis.finite_size import finite_sizes
from agglom_mpi.analysis.quantity_means import (
    MEASURED_ON,
    as_entries,
    drawn_fraction,
    quantity_means,
)
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.shown_units import column_of
from agglom_mpi.analysis.tables import time_of_strings
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_duration, in_unit
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

SEARCHED: Final = (
    "objective",
    "standard_error",
    "mean_radius_ratio",
    "growth_number",
    "mean_grains",
)
"""Columns of `/results` that are shown of a string."""
FRESH_COLUMNS: Final = (
    Column("fresh objective", "objective, re-estimate"),
    Column("fresh lower", "95 % from", format=".4f"),
    Column("fresh upper", "95 % to", format=".4f"),
    Column("fresh mean_radius_ratio", "mean b/b0, re-estimate", format=".4g"),
    Column("fresh samples", format="d"),
)
"""Columns on the `reestimate`, of fresh samples."""
LIMIT_COLUMNS: Final = (
    Column("limit", "mean b/b0 for many grains"),
    Column("shift", "shift by finite size"),
    Column("limit_objective", "objective for many grains"),
)
"""Columns on the `finite_size`, of fresh samples in several control volumes."""
GROWTH_COLUMNS: Final = (
    Column("filled", "volume fraction drawn"),
    Column("mean_radius_ratio", "mean b/b0, as searched", format=".4g"),
    Column("growth_number", "(mean b/b0)³, as searched", format=".4g"),
    Column("mean_grains", "grains per particle, as searched", format=".4g"),
    Column("samples", "samples used", format="d"),
)
"""Columns on the growth, of the samples that a string was chosen by."""


def best_table(file: CampaignData, best: Sequence[dict[str, Any]]) -> Table:
    """Return the table of entries of `collect_best`, in the units of the campaign file."""
    objective = Column("objective", "objective, as searched")
    timed = all(math.isfinite(entry["processor_seconds"]) for entry in best)
    kind = ("processor_seconds", "processor time") if timed else ("seconds", "wall-clock time")
    columns = [
        Column("rank"),
        Column("string", format="d"),
        *variable_columns(file, best),
        *(objective, *_moment_columns(best, "as searched")),
        *(*FRESH_COLUMNS, *_moment_columns([e["reestimate"] for e in best], "re-estimate")),
        *LIMIT_COLUMNS,
        *(
            Column(f"{name}, {measured}", f"{in_unit(name, unit)}, {measured}")
            for name, unit in file.sizes.quantities.items()
            for measured in MEASURED_ON
        ),
        *GROWTH_COLUMNS,
        Column(*kind, format=format_duration),
    ]
    rows = [_shown(file, place, entry) for place, entry in enumerate(best, 1)]
    return Table(columns, rows, name="best_strings", upright=True)


def variable_columns(file: CampaignData, best: Sequence[dict[str, Any]]) -> Iterator[Column]:
    """Yield the columns of the variables and derived quantities of entries of `collect_best`."""
    text = file.campaign_text
    for variable in recorded_box(file).variables:
        if variable.is_used:
            note = "" if variable.is_searched else "fixed"
            shown = column_of(text, variable.name, variable.unit, variable.upper, note)
            yield shown._replace(constant=bool(note))
    for column in derived_columns(file):
        values = [entry[column.name] for entry in best]
        shown = column_of(
            text, column.name, column.unit, float(np.nanmax(np.abs(values), initial=0.0))
        )
        yield shown._replace(
            constant=len(values) > 1 and np.allclose(values, values[0], 1e-12, 0.0)
        )


def _moment_columns(entries: Sequence[dict[str, Any] | None], measured: str) -> Iterator[Column]:
    """Yield columns on what was reached of each target of moments, and its share."""
    found = [entry.get("moments", {}) for entry in entries if entry]
    for name, first in next(filter(None, found), {}).items():
        wanted = f"{name}, wanted {first['target']:g}, {measured}"
        yield Column(f"{measured} {name} value", wanted, format=".4g")
        yield Column(f"{measured} {name} miss", "adds to objective", format=".4g")


def _shown(file: CampaignData, place: int, entry: dict[str, Any]) -> dict[str, Any]:
    """Return the values of a string by the keys of the columns; pairs are means and errors."""
    again, size = entry["reestimate"] or {}, entry.get("finite_size") or {}
    row = {"rank": f"#{place}", **entry, **{f"fresh {key}": again[key] for key in again}}
    row["objective"] = entry["objective"], entry["standard_error"]
    if again:
        row["fresh objective"] = again["objective"], again["standard_error"]
    for key in ("limit", "shift", "limit_objective"):
        row[key] = (size[key], size[f"{key}_standard_error"]) if size else None
    for measured, source in zip(MEASURED_ON, (entry, again), strict=True):
        for name, reached in source.get("moments", {}).items():
            row |= {f"{measured} {name} {key}": reached[key] for key in ("value", "miss")}
    for name, means in quantity_means(file, entry["string"]).items():
        for measured, mean in zip(MEASURED_ON, means, strict=True):
            row[f"{name}, {measured}"] = (mean.value, mean.error) if mean.samples else None
    if drawn := entry.get("drawn_volume_fraction"):
        row["filled"] = drawn["mean"], drawn["standard_error"]
    return row


def collect_best(file: CampaignData, count: int) -> list[dict[str, Any]]:
    """Return the numbers of the best strings, an entry each, the best first.

    Each has a `reestimate` on its fresh samples, None if it has none. It has `moments` if the
    objective has targets of them, `drawn_volume_fraction` if grains differ in size, `quantities` if
    samples have some, and a `finite_size` if there are larger volumes.
    """
    rows, estimates, order = rank_strings(file)
    again = {estimate.string: estimate for estimate in estimates}
    parameters = {int(row["string"]): row for row in file.string_rows()}
    samples, room = file.all_sample_rows(), max(parameters, default=-1) + 1
    wall, cpu = (time_of_strings(samples, room, name) for name in ("seconds", "cpu_seconds"))
    best = []
    for string in order[:count]:
        entry = _entry(file, rows[string], parameters[string], again.get(string))
        entry |= {"seconds": float(wall[string]), "processor_seconds": float(cpu[string])}
        if (drawn := drawn_fraction(file, string)) is not None:
            entry["drawn_volume_fraction"] = drawn.as_dict()
        if file.sizes.quantities:
            entry["quantities"] = as_entries(file, string)
        if file.volumes:
            size = finite_sizes(file).get(string)
            entry["finite_size"] = None if size is None else size.as_dict()
        for column in derived_columns(file):
            entry[column.name] = float(values_of(file, [string], column.name)[0])
        best.append(entry)
    return best


def _entry(
    file: CampaignData, result: np.void, string: np.void, again: Estimate | None
) -> dict[str, Any]:
    """Return the numbers of a string: as searched, and under `reestimate` on fresh samples."""
    number, law = int(result["string"]), objective_of(file)
    entry: dict[str, Any] = {"string": number}
    entry |= {n: float(string[n]) for n in file.variables.names if not np.isnan(string[n])}
    for name in SEARCHED:
        entry[name] = float(result[name])
    entry["samples"] = int(result["samples_used"])
    entry["reestimate"] = again and {name: getattr(again, name) for name in REESTIMATED}
    if law.has_moments:
        rows = file.all_sample_rows()
        rows = rows[(rows["string"] == number) & (rows["state"] == COMPLETED)]
        used = rows["sample"] < file.samples_used.get(number, 0)
        places = [(entry, used), (entry["reestimate"], rows["sample"] >= file.fresh_from)]
        for place, some in places[: 1 + (again is not None)]:
            reached = law.reached(summaries(rows[some]))
            place["moments"] = {moment.name: moment.as_dict() for moment in reached}
    return entry
