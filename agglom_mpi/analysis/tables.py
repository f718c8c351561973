"""The tables of a campaign file as pandas DataFrames."""

from types import ModuleType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.analysis.derived import derived_columns, recorded_box
from agglom_mpi.analysis.estimates import Estimate, estimates_of
from agglom_mpi.analysis.quantity_means import quantity_table
from agglom_mpi.analysis.ranking import order_by_estimates, search_order
from agglom_mpi.errors import require_library
from agglom_mpi.formatting import csv_cell
from agglom_mpi.measurements.layout import census_names
from agglom_mpi.outcome import REASONS
from agglom_mpi.search.proposals import ORIGINS
from agglom_mpi.storage.schema import (
    RESULTS,
    SAMPLES,
    STATES,
    Column,
    generations_schema,
    samples_schema,
    strings_schema,
)
from agglom_mpi.variables import Variable

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.storage.reader import CampaignData


def table_of(data: "CampaignData", name: str) -> "pd.DataFrame":
    """Tabulate the `strings`, `samples`, … of a file; see `TABLES`."""
    return TABLES[name](data)


def strings(data: "CampaignData") -> "pd.DataFrame":
    """Tabulate counted strings, variables in use, derived columns and results: nan or 0 if none.

    `seconds` and `cpu_seconds` are the wall-clock and the processor time of all samples of a
    string; the latter is nan in files of format versions 1 and 2.
    """
    pandas, every, results = _pandas(), data.string_rows(), data.result_rows()
    counted = data.with_unused | np.isin(every["string"], [*data.samples_used])
    rows = every[counted]
    samples = data.all_sample_rows()
    unused = set(data.variables.names) - {variable.name for variable in _used(data)}
    first = _columns(pandas, rows, without={"origin", "parents", *unused})
    first.insert(3, "origin", _texts(rows["origin"], ORIGINS))
    first.insert(4, "parent_1", rows["parents"][:, 0])
    first.insert(5, "parent_2", rows["parents"][:, 1])
    derived = derived_columns(data)
    for column in derived:
        first[column.name] = column.values[counted]
    second = _columns(pandas, results).set_index("string").reindex(rows["string"])
    second = second.reset_index(drop=True)
    second["hit_maximum"] = second["hit_maximum"] == 1
    for name in ("samples_used", "failed"):
        second[name] = second[name].fillna(0).astype(np.int64)
    room = int(rows["string"].max(initial=-1)) + 1  # a damaged row is absent
    for name in ("seconds", "cpu_seconds"):
        second[name] = time_of_strings(samples, room, name)[rows["string"]]
    columns = quantity_table(data, rows["string"].tolist(), fresh=False)
    for name, (values, _) in columns.items():
        second[name] = values
    fields = strings_schema(data.variables).fields + RESULTS.fields + SAMPLES.fields
    table = _with_units(pandas.concat([first, second], axis=1), fields)
    table.attrs["units"] |= {column.name: column.unit for column in derived}
    table.attrs["units"] |= {name: unit for name, (_, unit) in columns.items()}
    return table


def time_of_strings(samples: np.ndarray, strings: int, column: str) -> np.ndarray:
    """Return the time, s, of all samples of each string, used or not, (strings,).

    `column` is `seconds` for wall-clock time, `cpu_seconds` for processor time, which is nan where
    it was not recorded.
    """
    return np.bincount(samples["string"], samples[column], minlength=strings)


def time_on_free_core(samples: np.ndarray) -> np.ndarray:
    """Return the time, s, that each sample takes on a core that does nothing else, (n,).

    This is its processor time, or its wall-clock time where the former was not recorded.
    """
    cpu = samples["cpu_seconds"]
    return np.where(np.isnan(cpu), samples["seconds"], cpu)


def wall_over_cpu(samples: np.ndarray) -> float:
    """Return the ratio of wall-clock to processor time of all samples; nan if it is unknown."""
    cpu = float(samples["cpu_seconds"].sum())
    return float(samples["seconds"].sum()) / cpu if cpu > 0.0 else float("nan")


def samples(data: "CampaignData") -> "pd.DataFrame":
    """Tabulate counted samples; results rest on `used` ones, and never on `fresh` ones.

    Temperatures are nan where the scene has none.
    """
    rows = data.counted_samples
    without = {"state", "reason", *census_names(rows.dtype.names)}
    frame = _columns(_pandas(), rows, without=without)
    frame.insert(2, "state", _texts(rows["state"], STATES))
    frame.insert(3, "used", data.are_used(rows))
    frame.insert(4, "reason", _texts(rows["reason"], REASONS))
    frame.insert(5, "fresh", rows["sample"] >= data.fresh_from)
    if not data.has_temperature:
        frame["mean_temperature"] = frame["mean_temperature"].where(frame["mean_temperature"] > 0.0)
    schema = samples_schema(data.sizes.quantities, data.sizes.census)
    return _with_units(frame, schema.fields)


def estimates(data: "CampaignData") -> "pd.DataFrame":
    """Tabulate estimates on fresh samples, one row each, with the variables in use."""
    rows = estimates_of(data)
    frame = _pandas().DataFrame(rows, columns=list(Estimate._fields))
    counts = {"string", "samples", "failed"}
    for name in frame.columns:
        frame[name] = frame[name].astype(np.int64 if name in counts else np.float64)
    units = {name: "" if name == "string" else "1" for name in frame.columns}
    strings = [estimate.string for estimate in rows]
    for place, variable in enumerate(_used(data), 1):
        frame.insert(place, variable.name, data.values(strings, variable.name))
        units[variable.name] = variable.unit
    for name, (values, unit) in quantity_table(data, strings, fresh=True).items():
        frame[name], units[name] = values, unit
    frame.attrs["units"] = units
    return frame


ESTIMATED: Final = {
    "estimate": "objective",
    "estimate_standard_error": "standard_error",
    "estimate_mean_radius_ratio": "mean_radius_ratio",
}
"""Columns of `best` that are of fresh samples, and their names in an `Estimate`."""


def best(data: "CampaignData", count: int) -> "pd.DataFrame":
    """Tabulate the best strings as `strings` does, with their estimates on fresh samples."""
    table, known = strings(data), {each.string: each for each in estimates_of(data)}
    judged = set(table["string"][table["samples_used"] > 0])  # a damaged row is absent
    own = search_order(data, data.result_rows())
    order = [string for string in order_by_estimates(own, known.values()) if string in judged]
    frame = table.set_index("string", drop=False).loc[order[:count]].reset_index(drop=True)
    again = [known.get(string) for string in frame["string"]]
    for column, name in ESTIMATED.items():
        frame[column] = [np.nan if each is None else getattr(each, name) for each in again]
    frame.attrs["units"] = table.attrs["units"] | dict.fromkeys(ESTIMATED, "1")
    for name, (values, unit) in quantity_table(data, frame["string"], fresh=True).items():
        frame[name], frame.attrs["units"][name] = values, unit
    return frame


def generations(data: "CampaignData") -> "pd.DataFrame":
    """Tabulate generations; `population` holds an array of string numbers, the best first."""
    rows = data.generation_rows()
    frame = _columns(_pandas(), rows, without={"population"})
    frame["population"] = list(rows["population"])
    return _with_units(frame, generations_schema(1).fields)


def variables(data: "CampaignData") -> "pd.DataFrame":
    """Tabulate the variables that the campaign uses."""
    names = ("name", "unit", "lower", "upper", "is_searched")
    used = [[getattr(variable, name) for name in names] for variable in _used(data)]
    return _pandas().DataFrame(used, columns=[name.removeprefix("is_") for name in names])


def table_of_entries(rows: list[dict[str, Any]], columns: list[str]) -> "pd.DataFrame":
    """Tabulate plain values of strings, pure numbers but for times; `columns` without any."""
    frame = _pandas().DataFrame(rows, columns=None if rows else columns)
    units = {"string": "", "cpu_seconds": "s"}
    frame.attrs["units"] = {name: units.get(name, "1") for name in frame.columns}
    return frame


TABLES: Final = {
    each.__name__: each for each in (generations, estimates, strings, samples, variables)
}
"""All tables by name; no row of a growing file is read before those that refer to it."""


def with_units(table: "pd.DataFrame") -> "pd.DataFrame":
    """Return a table as CSV has it: units in its column names, populations as spaced numbers.

    Its texts are those of `csv_texts`.
    """
    units, table = table.attrs["units"], table.copy()
    if "population" in table:
        table["population"] = [" ".join(map(str, ids)) for ids in table["population"]]
    table = csv_texts(table)
    return table.rename(
        columns={name: f"{name} ({unit})" for name, unit in units.items() if unit not in ("", "1")}
    )


def csv_texts(table: "pd.DataFrame") -> "pd.DataFrame":
    """Return a table whose texts no spreadsheet takes for formulas; see `csv_cell`."""
    table = table.rename(columns=csv_cell)
    for name in table:
        if table[name].dtype.kind == "O":
            safe = {value: csv_cell(value) for value in table[name] if isinstance(value, str)}
            table[name] = [safe.get(value, value) for value in table[name]]
    return table


def _used(data: "CampaignData") -> list[Variable]:
    return [variable for variable in recorded_box(data).variables if variable.is_used]


def _columns(
    pandas: ModuleType, rows: np.ndarray, without: set[str] | frozenset[str] = frozenset()
) -> "pd.DataFrame":
    names = [name for name in rows.dtype.names or () if name != "crc" and name not in without]
    return pandas.DataFrame({name: np.ascontiguousarray(rows[name]) for name in names})


def _texts(codes: np.ndarray, texts: tuple[str, ...]) -> list[str]:
    return [texts[code] if code < len(texts) else f"unknown ({code})" for code in codes.tolist()]


def _with_units(frame: "pd.DataFrame", fields: tuple[Column, ...]) -> "pd.DataFrame":
    units = {field.name: field.unit for field in fields}
    frame.attrs["units"] = {name: units.get(name, "") for name in frame.columns}
    return frame


def _pandas() -> ModuleType:
    require_library("pandas", "report", "tables")
    import pandas

    return pandas
