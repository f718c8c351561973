"""The machine code of kernels on the disc, which is checked before it is used.

Numba trusts the files of its cache. One that a full disc, a killed copy or a bad block has damaged
ends the program then, each time anew, or is run as it is. Here every file is compared with a digest
of what was written. A file that cannot be read is a miss: it is dropped, and the kernel is compiled
again.

An index says which data file belongs to which types of arguments. Data files are named after their
content, so that two processes that write at once, or a copy that mixes two caches, never make an
index name the machine code of another kernel.

Kernels for laws of one's own have a folder for each combination of modules, below that of all
others: an index can be read only where the classes that it names are known.
"""

import errno
import glob
import hashlib
import logging
import pickle
import stat
import uuid
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numba
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    NullCache,
    UserProvidedCacheLocator,
)
from numba.core.serialize import dumps
from numba.core.types import BaseTuple, NamedTuple, NamedUniTuple

from agglom_mpi.compilation.stages import OWN_PREFIX, module_key

LOG: Final = logging.getLogger(__name__)
"""Receives one line on the first file of a folder that cannot be read, or not be written."""

MAX_BYTES: Final = 1 << 30
"""Largest file that is read; one of a kernel has some megabytes."""

_DIGEST: Final = hashlib.sha256().digest_size
_REPORTED: Final[set[str]] = set()


def report_folder(folder: Path, text: str) -> None:
    """Log a warning about a folder, once in a process for each folder."""
    if str(folder) not in _REPORTED:
        _REPORTED.add(str(folder))
        LOG.warning("warning: compiled kernels in %s: %s", folder, text)


def _reason(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or type(error).__name__


class CheckedFiles:
    """The index and the data files of one kernel; the index begins with the digest of its rest.

    Parameters
    ----------
    folder
    name
        Begins the names of all files.
    stamp
        Of the source of the kernel; what was written under another one is not used.
    """

    def __init__(self, folder: Path, name: str, stamp: object) -> None:
        self.folder = folder
        self.index = folder / f"{name}.nbi"
        self._name = name
        self._origin = numba.__version__, stamp

    def load(self, key: object) -> Any:
        """Return the data of a key, or None if there are none.

        Raises
        ------
        Exception
            If index or data cannot be read, or are not what was written.
        """
        digest = self._read_index().get(key)
        if digest is None:
            return None
        try:
            content = _content(self._data_path(digest))
        except FileNotFoundError:  # it was dropped
            return None
        _compare(content, digest)
        return pickle.loads(content)

    def save(self, key: object, data: object) -> None:
        """Write data first, and then the index that names them; raises an OSError if it cannot."""
        content = dumps(data)
        digest = hashlib.sha256(content).digest()
        _write(self._data_path(digest), content)
        try:
            digests = self._read_index()
        except Exception:  # `load` has reported it
            digests = {}
        rest = dumps((self._origin, digests | {key: digest}))
        _write(self.index, hashlib.sha256(rest).digest() + rest)

    def flush(self) -> None:
        """Forget everything."""
        for path in (self.index, *self.folder.glob(f"{glob.escape(self._name)}.*.nbc")):
            _drop(path)

    def drop(self, key: object) -> Path:
        """Drop the data of a key; everything if the index cannot be read. Return what was bad."""
        try:
            path = self._data_path(self._read_index()[key])
        except Exception:
            self.flush()
            return self.index
        _drop(path)
        return path

    def _read_index(self) -> dict[object, bytes]:
        try:
            content = _content(self.index)
        except FileNotFoundError:
            return {}
        _compare(content[_DIGEST:], content[:_DIGEST])
        origin, digests = pickle.loads(content[_DIGEST:])
        return dict(digests) if origin == self._origin else {}

    def _data_path(self, digest: bytes) -> Path:
        return self.folder / f"{self._name}.{digest.hex()[:16]}.nbc"


def _content(path: Path) -> bytes:
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):  # a pipe would be waited for
        raise OSError(errno.EINVAL, "not a regular file")
    if found.st_size > MAX_BYTES:
        raise OSError(errno.EFBIG, f"larger than {MAX_BYTES >> 20} MiB")
    return path.read_bytes()


def _compare(content: bytes, digest: bytes) -> None:
    if hashlib.sha256(content).digest() != digest:
        raise ValueError("altered or cut short")


def _write(path: Path, content: bytes) -> None:
    """Replace a file as a whole."""
    temporary = path.with_name(f"{path.name}.{uuid.uuid4().hex[:16]}")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise


def _drop(path: Path) -> None:
    with suppress(OSError):  # the folder may be closed to this user
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
        else:
            path.unlink()


class _OneFolder(CompileResultCacheImpl):
    """Numba's description of a kernel, kept in `numba.config.CACHE_DIR` or nowhere.

    Numba would go on to `__pycache__`, where it does not notice an edit of what a kernel calls.
    """

    _locator_classes: Any = (UserProvidedCacheLocator,)


def own_modules_of(types: Any) -> list[str]:
    """Return the names of the modules of one's own that types of Numba refer to, sorted."""
    found: set[str] = set()
    left = list(types)
    while left:
        each = left.pop()
        if isinstance(each, NamedTuple | NamedUniTuple):
            found.add(each.instance_class.__module__)
        if isinstance(each, BaseTuple):
            parts: Any = each
            left += parts.types
    return sorted(name for name in found if name.startswith(OWN_PREFIX))


class KernelCache(FunctionCache):
    """The cache of one kernel: what cannot be read is compiled again, and reported once."""

    _impl_class = _OneFolder

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._folder = Path(self._impl.locator.get_cache_path())
        self._cache_file = self._files_in(self._folder)

    def _files_in(self, folder: Path) -> CheckedFiles:
        stamp = self._impl.locator.get_source_stamp()
        return CheckedFiles(folder, self._impl.filename_base, stamp)

    def _choose_folder(self, sig: Any) -> None:
        """Choose the folder for the types of arguments; Numba's lock is held meanwhile."""
        modules = own_modules_of(sig)
        digest = hashlib.sha256(" ".join(map(module_key, modules)).encode()).hexdigest()[:16]
        folder = self._folder / f"{OWN_PREFIX}{digest}" if modules else self._folder
        if folder != self._cache_file.folder:
            self._cache_file = self._files_in(folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return a compiled kernel for these types, or None if it is to be compiled."""
        self._choose_folder(sig)
        try:
            return super().load_overload(sig, target_context)
        except MemoryError:  # says nothing about the file
            raise
        except Exception as error:  # whatever reading machine code raises
            key = self._index_key(sig, target_context.codegen())
            bad = self._cache_file.drop(key)
            report_folder(
                bad.parent,
                f"{bad.name} cannot be read ({_reason(error)}); what cannot be read is "
                "dropped and compiled again",
            )
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write a compiled kernel; without room for it the next process compiles it again."""
        self._choose_folder(sig)
        try:
            self._cache_file.folder.mkdir(exist_ok=True)
            super().save_overload(sig, data)
        except OSError as error:
            report_folder(self._cache_file.folder, f"cannot be written ({_reason(error)})")


def cache_of(function: Callable[..., Any], folder: Path) -> Any:
    """Return the cache of a kernel in a folder; one that keeps nothing where there is no place."""
    config: Any = numba.config
    config.CACHE_DIR = str(folder)
    try:
        return KernelCache(function)
    except RuntimeError:  # no locator
        report_folder(folder, f"those of {function.__module__} cannot be kept there")
        return NullCache()
