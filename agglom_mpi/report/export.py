"""A campaign file in other forms, as `agglom export` writes it: a copy, tables, netCDF, JSON."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from agglom_mpi.analysis.finite_size import limits_table, volumes_table
from agglom_mpi.analysis.tables import TABLES, with_units
from agglom_mpi.errors import UserError, require_library
from agglom_mpi.formatting import pluralise
from agglom_mpi.storage.compact import write_compact
from agglom_mpi.storage.files import atomic_file, require_absent
from agglom_mpi.storage.reader import CampaignData, read_campaign, read_inversion
from agglom_mpi.storage.recorded_campaign import code_note

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.inference.emulator_file import EmulatorRequest
    from agglom_mpi.report.paraview import FrameSelection, SelectedSample
    from agglom_mpi.report.set_files import SetRequest


class ExportError(UserError, ValueError):
    """A report or an export that cannot be made, with the reason in one line."""


class Exports(NamedTuple):
    """Files to write; None: do not.

    Attributes
    ----------
    compact
        Path of the compressed copy.
    tables
        Directory of the CSV tables, which is made.
    xarray
        Path of the netCDF file with strings and samples.
    arviz
        Path of the netCDF file with draws.
    draws
        What `arviz` and `json` hold without data: of the posterior of a measured mean,
        or of the feasible set.
    selection
        Samples for ParaView.
    json
        Path of the JSON file with the posterior of all data, or with the feasible set.
    emulator
        The emulator for NumPy alone.
    """

    compact: Path | None = None
    tables: Path | None = None
    xarray: Path | None = None
    arviz: Path | None = None
    draws: "SetRequest | None" = None
    selection: "FrameSelection | None" = None
    json: Path | None = None
    emulator: "EmulatorRequest | None" = None


def export(
    source: Path, exports: Exports, allow_code: bool = False, with_unused: bool = False
) -> Iterator[str]:
    """Write a campaign file in other forms, and yield a line on each file that is written.

    Parameters
    ----------
    source
        The campaign file.
    exports
        What to write.
    allow_code
        Whether code of one's own that the file has may be executed.
    with_unused
        Whether samples that ran ahead unused are counted and written, too.

    Raises
    ------
    CampaignError
        If the samples for ParaView cannot be shown, as from `select_samples`, `write_samples`.
    ExportError, MissingLibraryError
        If a name that is to be a directory is none, or pandas or xarray is missing.
    NoFeasibleSetError, PosteriorError, NoEmulatorError, TooManySamplesError
        If there is nothing to draw from or to emulate, or padded arrays would be too large.
    NotACampaign, OSError
        As from `write_compact`; before anything is written, if any of the files is there already.
    """
    compact, directory, selection = exports.compact, exports.tables, exports.selection
    netcdf = exports.xarray is not None or exports.arviz is not None
    of_search = any((selection, exports.arviz, exports.json, exports.emulator))
    file = (read_inversion if of_search else read_campaign)(source, allow_code)
    file.with_unused = with_unused
    # Imported below: each form has libraries that are of no use to the others.
    if exports.draws is not None:
        from agglom_mpi.config.plan import DEFAULT_TOLERANCE
        from agglom_mpi.report.set_files import is_of_data

        asked = exports.draws.tolerance != DEFAULT_TOLERANCE or exports.draws.robust
        if asked and is_of_data(file, exports.draws):
            message = "--tolerance is for a feasible set; of measured data the posterior is written"
            raise ExportError(f"{file.path}: {message}")
    targets = [path for path in (compact, exports.xarray, exports.arviz, exports.json) if path]
    if directory is not None:
        require_library("pandas", "report", "tables")
        require_directory(directory)
        targets += [directory / f"{name}.csv" for name in tables_of(file)]
    samples: list[SelectedSample] = []
    if selection is not None:
        from agglom_mpi.report.paraview import select_samples, write_samples

        samples = select_samples(file, selection)
    for target in [*targets, *(path for *_, path in samples)]:
        require_absent(target)
    if netcdf:
        from agglom_mpi.report.netcdf import require_netcdf, write_netcdf

        require_netcdf()
        if exports.draws is not None:
            exports.draws.check(file)
    if exports.emulator is not None:
        from agglom_mpi.inference.emulator_file import emulator_arrays

        exports.emulator.check()
        arrays = emulator_arrays(file, exports.emulator.tolerance)
    if compact is not None:
        copied = write_compact(source, compact)
        strings, rows = pluralise(copied.strings, "string"), pluralise(copied.samples, "sample")
        taken = source.stat().st_blocks * 512  # without its holes
        sizes = f"{compact.stat().st_size / 1e6:.3g} MB of {taken / 1e6:.3g} MB on disc"
        yield f"{compact}: {strings}, {rows}, {sizes}"
        if copied.damaged:
            yield f"{compact}: {pluralise(copied.damaged, 'damaged row')}, copied unchanged"
    if directory is not None:
        yield from write_tables(file, directory)
    if netcdf:
        yield from write_netcdf(file, exports.xarray, exports.arviz, exports.draws)
    if exports.json is not None:
        from agglom_mpi.report.set_files import write_json

        write_json(exports.json, file, exports.draws)
        yield f"{exports.json}: {pluralise(exports.json.stat().st_size, 'byte')}"
    if exports.emulator is not None:
        yield from exports.emulator.write(arrays)
    if selection is not None:
        yield from write_samples(file, samples, selection.frames)
    yield from (*filter(None, [code_note(file)]), *file.unused_notes)


def require_directory(path: Path) -> None:
    """Check that a path is a directory or absent.

    Raises
    ------
    ExportError
        If something else has this name.
    """
    if path.exists() and not path.is_dir():
        raise ExportError(f"{path}: is no directory")


def tables_of(file: CampaignData) -> Mapping[str, Callable[[CampaignData], "pd.DataFrame"]]:
    """Return what makes each table that is written of a file, by name.

    No row of a growing file is read before those that refer to it. Tables of volumes are written
    where it has samples in several, that of estimates not without code of its own that may not run.
    """
    tables = {name: make for name, make in TABLES.items() if name != "variables"}
    if code_note(file):
        del tables["estimates"]
    elif file.volumes:
        tables = {"limits": limits_table, "volumes": volumes_table, **tables}
    return tables


def write_tables(file: CampaignData, directory: Path) -> Iterator[str]:
    """Write the tables as CSV into a directory, and yield a line on each.

    The directory is made; no table has its name before all are complete. Numbers are written with
    as many digits as tell them apart, so that they read back to the same float64, by Python's
    `float` and by whatever else rounds correctly.

    Raises
    ------
    FileExistsError
        If there is such a table already.
    OSError
        If they cannot be written.
    """
    made = tables_of(file).items()
    tables = {directory / f"{name}.csv": with_units(make(file)) for name, make in made}
    directory.mkdir(parents=True, exist_ok=True)
    with ExitStack() as files:
        for path, table in tables.items():
            temporary = files.enter_context(atomic_file(path))
            table.to_csv(temporary, index=False, na_rep="nan", lineterminator="\n")
    for path, table in tables.items():
        yield f"{path}: {pluralise(len(table), 'row')}"
