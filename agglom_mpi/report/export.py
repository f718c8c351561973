"""What `agglom export` writes of a campaign file: a compact copy, tables, files for ParaView."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Final

from agglom_mpi.analysis.tables import table_of
from agglom_mpi.errors import UserError, require_library
from agglom_mpi.storage.compact import write_compact
from agglom_mpi.storage.files import atomic_file, require_absent
from agglom_mpi.storage.reader import CampaignData, read_campaign, read_inversion

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.report.paraview import Choice

TABLES: Final = ("generations", "strings", "samples")
"""In an order in which no row of a growing file is read before those that refer to it."""


class ExportError(UserError, ValueError):
    """The export is not possible; one line says why."""


def export(
    source: Path,
    compact: Path | None,
    directory: Path | None,
    paraview: "Choice | None" = None,
) -> Iterator[str]:
    """Write what is asked for, yielding a line on each file that is there; see `agglom export`.

    Raises
    ------
    CampaignError
        If the samples to show in ParaView cannot be, as from `chosen` and `write_samples`.
    ExportError, MissingLibraryError
        If a name that is to be a directory is none, or pandas is missing.
    NotACampaign, OSError
        As from `write_compact`; before anything is written, if any of the files is there already.
    """
    file = read_campaign(source) if paraview is None else read_inversion(source)
    if directory is not None:
        require_library("pandas", "report", "tables")
        check_directory(directory)
    targets = [directory / f"{name}.csv" for name in TABLES] if directory is not None else []
    if compact is not None:
        targets.insert(0, compact)
    shown = []
    if paraview is not None:
        from agglom_mpi.report.paraview import chosen, write_samples

        shown = chosen(file, paraview)
        targets += [each.path for each in shown]
    for target in targets:
        require_absent(target)
    if compact is not None:
        copied = write_compact(source, compact)
        sizes = _sizes(compact, source)
        yield f"{compact}: {copied.strings} strings, {copied.samples} samples, {sizes}"
        if copied.damaged:
            yield f"{compact}: {copied.damaged} damaged rows, copied as they are"
    if directory is not None:
        yield from write_tables(file, directory)
    if paraview is not None:
        yield from write_samples(file, shown, paraview.frames)


def check_directory(path: Path) -> None:
    """Raise an ExportError if there is something else under the name of a directory."""
    if path.exists() and not path.is_dir():
        raise ExportError(f"{path}: is no directory")


def _sizes(copy: Path, original: Path) -> str:
    """Bytes of a copy, and those that the original takes, without its holes."""
    taken = original.stat().st_blocks * 512
    return f"{copy.stat().st_size / 1e6:.3g} MB of {taken / 1e6:.3g} MB on disc"


def write_tables(file: CampaignData, directory: Path) -> Iterator[str]:
    """Write the three tables into a directory, which is made; no name appears before all are whole.

    Numbers are written with as many digits as tell them apart, so that they read back to the same
    float64, by Python's `float` and by whatever else rounds correctly.
    """
    tables = {directory / f"{name}.csv": as_columns(table_of(file, name)) for name in TABLES}
    directory.mkdir(parents=True, exist_ok=True)
    with ExitStack() as files:
        for path, table in tables.items():
            temporary = files.enter_context(atomic_file(path))
            table.to_csv(temporary, index=False, na_rep="nan", lineterminator="\n")
    for path, table in tables.items():
        yield f"{path}: {len(table)} rows"


def as_columns(table: "pd.DataFrame") -> "pd.DataFrame":
    """Name the columns with their units, and write a population as numbers with spaces between."""
    table = table.copy()
    if "population" in table:
        table["population"] = [" ".join(map(str, ids)) for ids in table["population"]]
    units = table.attrs["units"]
    return table.rename(
        columns={name: f"{name} ({unit})" for name, unit in units.items() if unit not in ("", "1")}
    )
