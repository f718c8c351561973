"""Opening a campaign file: without HDF5's locks and sieve buffer, and with clear errors."""

import errno
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import h5py
import numpy as np
from h5py import h5d, h5f, h5g, h5l, h5o, h5p

from agglom_mpi.errors import FAILURE, UserError
from agglom_mpi.file_kinds import YAML_IS_NO_HDF5, is_kernel_file, reads_like_a_campaign
from agglom_mpi.storage.attributes import check_attributes
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.schema import FORMAT, FORMAT_VERSION, VARIABLE_TABLE

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


_LEAST_ROOM: Final = 1 << 16
"""Free space of a disk, bytes, below which it counts as full."""

SYMPTOMS: Final = (
    *(ArithmeticError, AttributeError, LookupError, MemoryError),
    *(OSError, RuntimeError, TypeError, ValueError),
)
"""Exceptions that h5py, NumPy and the evaluation of rows raise where a file is damaged."""

_MOST_COMPRESSED: Final = 1032
"""Maximum compression ratio of gzip."""
_SMALL: Final = 1 << 20
"""Size of a table, bytes, up to which it may be absent from the file."""


class NotACampaign(UserError, ValueError):  # noqa: N818 - public name
    """The file is no campaign file that this program can read; one line says why."""


class DamagedCampaign(NotACampaign):
    """The file is a campaign file, but so damaged that it cannot be opened."""

    exit_code = FAILURE


def open_file(
    path: Path,
    *,
    write: bool = False,
    thorough: bool = True,
    world: "Intracomm | None" = None,
) -> h5py.File:
    """Open a campaign file and check that it is one.

    Parameters
    ----------
    path
        The file.
    write
        Whether to open it for writing, too.
    thorough
        Whether to check the columns of all tables, which takes longer than to read a few rows.
    world
        All ranks, if these open the file together; then they close it together, too.

    Raises
    ------
    NotACampaign
        If it is something else, of a newer format version, or a compact copy to be written to;
        truncated or damaged, a `DamagedCampaign`.
    OSError
        If it is missing or cannot be read; names the path.
    """
    flags = h5f.ACC_RDWR if write else h5f.ACC_RDONLY
    _check_kind(path)
    try:
        file = h5py.File(h5f.open(os.fsencode(path), flags, fapl=_access_list(world)))
    except OSError as error:
        if error.errno:
            raise with_path(error, path) from error
        raise _explain(path, str(error)) from error
    try:
        with report_damage(path):
            if thorough:
                _check_structure(file, path)
            _check_format(file, path)
            if thorough:
                _check_tables(file, path)
        if write:
            refuse_compact(file, path)
    except BaseException:
        if world is None:  # or it would wait for the others
            file.close()
        raise
    return file


def _check_kind(path: Path) -> None:
    """Raise NotACampaign for what HDF5 would wait for, or turn into a file of its own."""
    try:
        found = path.stat()
    except OSError:
        return  # HDF5 says why
    if stat.S_ISDIR(found.st_mode):
        return
    if not stat.S_ISREG(found.st_mode):
        raise NotACampaign(f"{path}: not a regular file")
    if is_kernel_file(path):
        raise NotACampaign(f"{path}: in /proc or /sys, which are not read")
    # Opened for writing, an empty file would silently become an HDF5 file.
    if found.st_size == 0:
        raise NotACampaign(f"{path}: not an HDF5 file (it is empty)")


def _check_structure(file: h5py.File, path: Path) -> None:
    """Raise NotACampaign if data lie in other files: to read them would show what is in those.

    Nothing is read that could lead there: links are examined before they are followed, and the
    layout of datasets before their extent, for which HDF5 would open the sources of a virtual one.
    """
    groups, seen = [file.id], set()
    while groups:
        group = groups.pop()
        for name in group:
            where = f"{path}: {name.decode(errors='replace')!r}"
            kind = group.links.get_info(name).type
            if kind == h5l.TYPE_SOFT:
                continue  # what it leads to is in this file, and is looked at there
            if kind != h5l.TYPE_HARD:
                raise NotACampaign(f"{where} is a link to another file, which is not followed")
            found = h5o.open(group, name)
            address = h5o.get_info(found).addr
            if isinstance(found, h5g.GroupID) and address not in seen:
                groups.append(found)
            seen.add(address)
            if isinstance(found, h5d.DatasetID) and _lies_elsewhere(found):
                raise NotACampaign(f"{where} has its data in other files, which are not read")


def _lies_elsewhere(dataset: h5d.DatasetID) -> bool:
    """Return whether a dataset is virtual, or has external storage."""
    creation = dataset.get_create_plist()
    layout = creation.get_layout()
    return layout == h5d.VIRTUAL or (layout == h5d.CONTIGUOUS and creation.get_external_count() > 0)


@contextmanager
def report_damage(path: Path) -> Iterator[None]:
    """Turn what h5py and NumPy raise where HDF5's own bytes are damaged into a DamagedCampaign.

    A failed system call, an OSError with a number, is no sign of damage and is passed on.
    """
    try:
        yield
    except NotACampaign:
        raise
    except SYMPTOMS as error:
        if isinstance(error, OSError) and error.errno:
            raise
        text = " ".join(str(error).removeprefix(f"{path}: ").split())
        raise DamagedCampaign(f"{path}: a damaged campaign file ({text})") from error


def read_attributes(file: h5py.File, path: Path) -> dict[str, Any]:
    """Read the attributes of a campaign file, numbers as Python's; raises DamagedCampaign."""
    with report_damage(path):
        return _attributes(file)


def _attributes(file: h5py.File) -> dict[str, Any]:
    return {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in file.attrs.items()
    }


def refuse_compact(file: h5py.File, path: Path) -> None:
    """Raise NotACampaign if a kill could tear a row that is written: rows lie in chunks."""
    if moved := tables_in_chunks(file):
        raise NotACampaign(
            f"{path}: a compact copy, which can be read but not continued ({moved[0]} lies in "
            "chunks); continue the file that it was made of, or start another with --output"
        )


def tables_in_chunks(file: h5py.File) -> list[str]:
    """Return the names of the tables that do not lie in a row, as in a compact copy."""
    names = [name for each in TableSizes.of(file.attrs).tables() for name in each.datasets]
    return [f"/{name}" for name in names if file[name].id.get_offset() is None]


def with_path(error: OSError | RuntimeError, path: Path) -> OSError:
    """Return an OSError with the number of a failed system call and the path.

    HDF5 puts the number into a long text, and h5py raises a RuntimeError where closing fails.
    """
    found = re.search(r"errno = (\d+)", str(error))
    number = getattr(error, "errno", None) or (int(found[1]) if found else None)
    if number is None and _is_full(path):  # MPI-IO does not say why it failed
        number = errno.ENOSPC
    if number == errno.EAGAIN:
        text = "locked by another process; unset HDF5_USE_FILE_LOCKING, or set it to FALSE"
        return OSError(number, text, str(path))
    if number:
        return OSError(number, os.strerror(number), str(path))
    return OSError(f"{path}: {error}")


def _is_full(path: Path) -> bool:
    try:
        room = os.statvfs(path)
    except OSError:
        return False
    return room.f_bavail * room.f_frsize < _LEAST_ROOM


def _access_list(world: "Intracomm | None" = None) -> h5p.PropFAID:
    access = h5p.create(h5p.FILE_ACCESS)
    if world is not None:
        from mpi4py import MPI

        access.set_fapl_mpio(world, MPI.Info())
    # A sieve buffer would hold rows back and let their done bytes reach the file first.
    access.set_sieve_buf_size(0)
    access.set_file_locking(False, True)
    # Newer formats mark a file that is open for writing and refuse it after a kill.
    access.set_libver_bounds(h5f.LIBVER_EARLIEST, h5f.LIBVER_LATEST)
    return access


def _explain(path: Path, message: str) -> NotACampaign:
    if "signature not found" in message:
        found = f"; {YAML_IS_NO_HDF5}" if reads_like_a_campaign(path) else ""
        return NotACampaign(f"{path}: not an HDF5 file{found}")
    if "truncated file" in message:
        return DamagedCampaign(f"{path}: a truncated HDF5 file")
    return DamagedCampaign(f"{path}: a damaged HDF5 file ({message})")


def _check_tables(file: h5py.File, path: Path) -> None:
    attributes = _attributes(file)
    sizes = check_attributes(attributes)
    # The attributes do not state how long these are.
    unstated = {name: len(file[name]) for name in ("generations", "legs", "failures")}
    capacities = sizes.capacities() | unstated
    for schema in sizes.tables():
        if file[schema.name].dtype != schema.dtype:
            raise NotACampaign(
                f"{path}: table /{schema.name} has other columns than this version of "
                f"agglom_mpi expects (written by version {attributes['code_version']})"
            )
        capacity = capacities[schema.name]
        for name in schema.datasets:
            if file[name].shape != (capacity,):
                raise ValueError(f"/{name} has the shape {file[name].shape}, not ({capacity},)")
            if file[name].nbytes > _SMALL + _MOST_COMPRESSED * file[name].id.get_storage_size():
                raise ValueError(f"/{name} has {capacity} rows, more than are in the file")
    known = [
        (variable.name.encode(), variable.unit.encode()) for variable in sizes.variables.variables
    ]
    box = file[VARIABLE_TABLE.name][...]
    if box[["name", "unit"]].tolist() != known:
        raise ValueError("/variables has other names or units")
    if np.isinf(box["lower"]).any() or np.isinf(box["upper"]).any():
        raise ValueError("/variables has an infinite bound")
    if not np.array_equal(box["searched"], box["lower"] < box["upper"]):
        raise ValueError("/variables has a searched variable without a range, or the reverse")


def _check_format(file: h5py.File, path: Path) -> None:
    kind, version = file.attrs.get("format"), file.attrs.get("format_version", 0)
    if not isinstance(kind, str) or kind != FORMAT:
        raise NotACampaign(f"{path}: an HDF5 file, but not an {FORMAT}")
    if not isinstance(version, int | np.integer):
        raise ValueError("attribute format_version is no whole number")
    if version < 1:
        raise NotACampaign(f"{path}: an {FORMAT} without a format version")
    if version > FORMAT_VERSION:
        raise NotACampaign(
            f"{path}: has format version {version}, and this program reads versions up to "
            f"{FORMAT_VERSION}: update agglom_mpi"
        )
