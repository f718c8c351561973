"""Tables of the finite size of the best strings as pandas DataFrames."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from agglom_mpi.analysis.finite_size import FiniteSize, finite_sizes
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.errors import require_library

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.storage.reader import CampaignData

UNITS: Final = {"string": "", "volume": "1", "grains": "1", "cpu_seconds": "s"}
"""Units of the columns whose unit is another one than 1, and of those that name a row."""


def volumes_table(data: "CampaignData") -> "pd.DataFrame":
    """Tabulate the means of the best strings in each control volume, one row each."""
    rows = [
        {"string": size.string, **entry}
        for size in _ranked(data)
        for entry in size.as_dict()["volumes"]
    ]
    return _table(rows, ["string", "volume", "grains"])


def limits_table(data: "CampaignData") -> "pd.DataFrame":
    """Tabulate the limits of the best strings for many grains, one row each, in order of rank."""
    rows = []
    for size in _ranked(data):
        entries = size.as_dict()
        del entries["volumes"]
        rows.append({"string": size.string, "grains": size.volumes[0].grains, **entries})
    return _table(rows, ["string", "grains", "limit", "limit_standard_error"])


def _ranked(data: "CampaignData") -> Iterator[FiniteSize]:
    sizes = finite_sizes(data)
    order = rank_strings(data).order if sizes else []
    yield from (sizes[string] for string in order if string in sizes)


def _table(rows: list[dict[str, Any]], columns: list[str]) -> "pd.DataFrame":
    """Return rows as a table; `columns` are those of an empty one."""
    require_library("pandas", "report", "tables")
    import pandas

    frame = pandas.DataFrame(rows, columns=None if rows else columns)
    frame.attrs["units"] = {name: UNITS.get(name, "1") for name in frame.columns}
    return frame
