"""Files as a whole: written at once or not at all, this program's own, altered by another one."""

import errno
import fcntl
import io
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import h5py
from h5py import h5f, h5fd, h5p

from agglom_mpi.errors import UserError
from agglom_mpi.storage.access import with_path
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.schema import STATUS


class CheckedFile(io.FileIO):
    """A new file that keeps the first failure to write, and ignores all writes after it.

    HDF5 cannot flush its cache of chunks once a write has failed: closing the file fails, and the
    next file that the process opens may crash it. So every write is reported as a success.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(os.fspath(path), "w+")
        self._error = 0

    def check(self) -> None:
        """Raise an OSError if a write has failed."""
        if self._error:
            raise OSError(self._error, os.strerror(self._error), self.name)

    def write(self, data: Any) -> int:
        """Write all of it, unless a write has failed; return its length in any case."""
        view = memoryview(data).cast("B")
        written = 0
        try:
            while not self._error and written < len(view):
                written += super().write(view[written:]) or 0
        except OSError as error:
            self._error = error.errno or errno.EIO
        return len(view)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move to a place in the file; one that the file system cannot have fails as a write."""
        try:
            return super().seek(offset, whence)
        except OSError:
            self._error = self._error or errno.EFBIG
            return offset

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file, unless a write has failed."""
        try:
            if not self._error:
                return super().truncate(size)
        except OSError as error:
            self._error = error.errno or errno.EIO
        return size or 0


@contextmanager
def new_file(path: Path) -> Iterator[tuple[h5py.File, CheckedFile]]:
    """Yield an empty HDF5 file in the oldest format, and the file object that it is written to.

    Raises
    ------
    OSError
        At the end, if a write failed; `CheckedFile.check` says so before.
    """
    with CheckedFile(path) as target:
        with h5py.File(h5f.create(os.fsencode(path), fapl=_access_list(target))) as file:
            yield file, target
        target.check()


def _access_list(target: CheckedFile) -> h5p.PropFAID:
    # Not to be kept: it holds the file object, which HDF5 releases after Python has ended.
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_fileobj_driver(h5fd.fileobj_driver, target)
    access.set_libver_bounds(h5f.LIBVER_EARLIEST, h5f.LIBVER_LATEST)
    return access


def require_absent(path: Path) -> None:
    """Raise FileExistsError if there is anything under this name."""
    if os.path.lexists(path):
        raise FileExistsError(errno.EEXIST, "exists already and is not overwritten", str(path))


def require_writable_folder(path: Path) -> None:
    """Raise an OSError unless the folder of a file exists and can be written."""
    folder = str(path.parent)
    if not os.path.lexists(folder):
        code = errno.ENOENT
    elif not os.path.isdir(folder):
        code = errno.ENOTDIR
    elif not os.access(folder, os.W_OK | os.X_OK):
        code = errno.EACCES
    else:
        return
    raise OSError(code, os.strerror(code), folder)


@contextmanager
def atomic_file(path: Path, *, replace: bool = False) -> Iterator[Path]:
    """Yield a name beside `path`; what has been written there at the end is renamed to `path`.

    So there is the whole file under its name, or what was there before. A kill leaves at most the
    hidden file of the other name, which the next attempt replaces.

    Parameters
    ----------
    path
        The file.
    replace
        Whether it may take the place, and has the permissions, of one that is there.

    Raises
    ------
    FileExistsError
        If there is a file already, before or after writing, and it is not to be replaced.
    OSError
        If it cannot be written, or another process is doing so; nothing is left behind.
    """
    if not replace:
        require_absent(path)
    temporary = path.with_name(f".{path.name}.new")
    with _sole_writer(temporary, path):
        try:
            yield temporary
            if not replace:
                require_absent(path)
            elif path.exists():
                shutil.copymode(path, temporary)
            sync(temporary)
            os.replace(temporary, path)
            sync(path.parent)
        except BaseException as error:
            temporary.unlink(missing_ok=True)
            known = isinstance(error, OSError) and error.filename not in (None, str(temporary))
            if isinstance(error, (OSError, RuntimeError)) and not known:
                raise with_path(error, path) from error
            raise


def replace_file(path: Path, content: bytes) -> None:
    """Write a file whole, in place of one that may be there; raises OSError as `atomic_file`."""
    with atomic_file(path, replace=True) as temporary:
        temporary.write_bytes(content)


class ForeignFileError(UserError, OSError):
    """A name that this program uses for a file of its own belongs to something else."""


def open_own(name: Path, path: Path) -> int:
    """Open or create a file beside a campaign's, for reading and writing, as what it must be.

    In a directory where others may write, somebody may have put a link there: to follow it would
    overwrite what it leads to.

    Parameters
    ----------
    name
        The file.
    path
        The file that it is for; whoever owns that one may own this one, too.

    Returns
    -------
    int
        Its descriptor.

    Raises
    ------
    ForeignFileError
        If it is a link, no regular file, or somebody else's.
    OSError
        If it cannot be opened.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
    try:
        descriptor = os.open(name, flags, 0o666)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise ForeignFileError(f"{name}: is a symbolic link; remove it") from error
        if error.errno in (errno.EISDIR, errno.ENXIO):
            raise ForeignFileError(f"{name}: is not a regular file; remove it") from error
        raise
    found = os.fstat(descriptor)
    mistake = ""
    if not stat.S_ISREG(found.st_mode):
        mistake = "is not a regular file"
    elif found.st_nlink != 1:
        mistake = "has a second name, a hard link"
    elif found.st_uid not in _owners(path):
        mistake = f"belongs to another user, number {found.st_uid}"
    if mistake:
        os.close(descriptor)
        raise ForeignFileError(f"{name}: {mistake}; remove it")
    return descriptor


def _owners(path: Path) -> set[int]:
    """Return the users who may own what lies beside a file: this one, and those who share it."""
    found = {os.geteuid()}
    for shared in (path, path.parent):
        with suppress(OSError):
            found.add(shared.stat().st_uid)
    return found


@contextmanager
def _sole_writer(temporary: Path, path: Path) -> Iterator[None]:
    """Hold a lock on the temporary file, which the kernel releases however the process ends."""
    try:
        descriptor = open_own(temporary, path)
    except ForeignFileError:
        raise
    except OSError as error:
        raise with_path(error, path) from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            message = "is being written by another process"
            raise OSError(errno.EBUSY, message, str(path)) from None
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(descriptor)


def require_in_place(path: Path, descriptor: int) -> None:
    """Raise FileNotFoundError, which says what is left, unless an open file has its name."""

    def is_at(name: str | Path) -> bool:
        try:
            return os.path.samestat(os.stat(name), os.fstat(descriptor))
        except OSError:
            return False

    if is_at(path):
        return
    message = "was removed or replaced while it was being written; it is lost"
    with suppress(OSError):
        if is_at(now := os.readlink(f"/proc/self/fd/{descriptor}")):
            kept = "everything written before is whole there: move it back and run again to go on"
            message = f"was moved to {now} while it was being written; {kept}"
    raise OSError(errno.ENOENT, message, str(path))


def sync(path: Path) -> None:
    """Wait until a file, or the names in a directory, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


_MOST_COMPARED: Final = 1 << 22
"""Maximum number of HDF5's own bytes that are compared; most files have less than 100 kB."""


class AlteredFileError(OSError):
    """Another program has truncated or overwritten a file that is being written."""


class Fingerprint:
    """Size of a campaign file and HDF5's own bytes; neither changes while rows are written.

    A program that truncates the file, or copies another one over it, leaves the name and the open
    descriptor as they are: rows would be written into what is left, and the run would end as if all
    were stored. A comparison takes some 50 µs.

    Parameters
    ----------
    file
        The campaign file, open.
    path
        Its name.
    descriptor
        Of the same file, for reading; the caller closes it.
    """

    def __init__(self, file: h5py.File, path: Path, descriptor: int) -> None:
        self._path, self._descriptor = path, descriptor
        self._size = os.fstat(descriptor).st_size
        self._known: list[tuple[int, bytes]] = []
        self._status = Rows(file[STATUS.name], path)
        left = _MOST_COMPARED
        for begin, end in _outside_rows(file, self._size):
            content = os.pread(descriptor, min(end - begin, left), begin)
            self._known.append((begin, content))
            left -= len(content)

    def check(self, status: bytes | None = None) -> None:
        """Raise an error unless the file is in its place and unaltered.

        Parameters
        ----------
        status
            The row of `/status` as it was written last; an older copy of the file has another.

        Raises
        ------
        FileNotFoundError
            If it was removed or replaced.
        AlteredFileError
            If it was truncated or overwritten.
        """
        require_in_place(self._path, self._descriptor)
        size = os.fstat(self._descriptor).st_size
        if size != self._size:
            raise self._error(f"it has {size:,} bytes instead of {self._size:,}")
        for begin, content in self._known:
            if os.pread(self._descriptor, len(content), begin) != content:
                raise self._error("it has other bytes")
        if status not in (None, self._status.read(0, 1).tobytes()):
            raise self._error("it has another status")

    def _error(self, what: str) -> AlteredFileError:
        message = (
            f"was truncated or overwritten by another program during the run ({what}); what it "
            "held may be lost: restore a copy, or start afresh with --output"
        )
        return AlteredFileError(errno.EIO, message, str(self._path))


def _outside_rows(file: h5py.File, size: int) -> Iterator[tuple[int, int]]:
    """Yield begin and end of the parts of a file of `size` bytes that hold no rows."""
    tables = TableSizes.of(file.attrs).tables()
    datasets = [file[name].id for table in tables for name in table.datasets]
    at = 0
    for begin, length in sorted((d.get_offset(), d.get_storage_size()) for d in datasets):
        if begin > at:
            yield at, begin
        at = max(at, begin + length)
    if at < size:
        yield at, size


def redirect_writes(file: h5py.File) -> None:
    """Let HDF5 write what it still writes into memory: the file may be somebody else's now.

    Even closing it would write its first block, and lengthen it.
    """
    if file.driver == "sec2":
        nothing = os.memfd_create("altered")
        os.dup2(nothing, file.id.get_vfd_handle(), inheritable=False)
        os.close(nothing)
