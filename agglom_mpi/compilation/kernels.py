"""Compile kernels with their stages, and cache them.

Numba does not notice an edit in a file that a cached kernel only calls into, so the cache folder is
keyed by a hash of every source that can end up in a kernel.
"""

import atexit
import functools
import gc
import hashlib
import logging
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, TypeVar

import llvmlite.binding as ll
import numba
from numba.core import event
from numba.extending import intrinsic, overload

from agglom_mpi.compilation import stages

_NOT_TRIED: Final = (
    f"numba {numba.__version__} is not a version that kernels were tried with: "
    "pip install 'numba>=0.62,<0.69'"
)
try:
    from agglom_mpi.compilation.kernel_cache import cache_of, report_folder
    from agglom_mpi.compilation.kernel_linking import COMPILER
except ImportError as _error:  # what Numba does not document may be absent
    raise ImportError(_NOT_TRIED, name="numba") from _error

_PACKAGE: Final = Path(__file__).parents[1]
_KERNEL_SOURCES: Final = (
    "compilation/*.py",
    "declaration/*.py",
    "judge.py",
    "measurements/layout.py",
    "outcome.py",
    "physics/*.py",
    "simulation/**/*.py",
)

_CONFIG: Any = numba.config
_KERNEL: Final[dict[str, Any]] = {
    "pipeline_class": COMPILER,
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "_nrt": True,
}
# Inlining saves copying the NamedTuples of arrays at every call: a factor of two and more.
_ALLOCATING: Final[dict[str, Any]] = {**_KERNEL, "forceinline": True, "no_cpython_wrapper": True}
# Without counting references to arrays, which costs more than half of the time of a short loop.
_INLINED: Final[dict[str, Any]] = {**_ALLOCATING, "_nrt": False}
_DISPATCHED: Final[dict[str, Any]] = {
    "pipeline_class": COMPILER,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "_nrt": False,
}
STAGE_OPTIONS: Final[dict[str, dict[str, Any]]] = {
    "inlined": _INLINED,
    "not inlined": {**_INLINED, "forceinline": False},
    "allocating": _ALLOCATING,
    "dispatched": _DISPATCHED,
    "dispatched, allocating": {**_DISPATCHED, "_nrt": True},
}
"""Options of Numba for each manner of compiling a stage."""

F = TypeVar("F", bound=Callable[..., Any])

LOG: Final = logging.getLogger(__name__)
"""Receives a line on each kernel that is compiled when it is first called."""


@functools.cache
def sources_digest() -> str:
    """Return a hash of all sources that end up in kernels: 64 hexadecimal digits."""
    digest = hashlib.sha256()
    for pattern in _KERNEL_SOURCES:
        for path in sorted(_PACKAGE.glob(pattern)):
            digest.update(path.relative_to(_PACKAGE).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _copy_folder(source: Path, target: Path) -> None:
    """Copy a folder as a whole, if there is one and the target is not there yet."""
    with suppress(OSError):  # the source may be closed to this user, the target there by now
        if source.is_dir() and not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=target.parent) as scratch:
                copy = shutil.copytree(source, Path(scratch) / "copy")
                for folder in (copy, *filter(Path.is_dir, copy.rglob("*"))):
                    folder.chmod(0o755)  # the read-only mode was copied, too
                copy.rename(target)


def others_may_write(folder: Path) -> bool:
    """Return whether users of no relation to this one may have put files into a folder.

    Kernels in it are unpickled, which runs what they say. A group that shares a folder is trusted.
    """
    ours = {0, os.geteuid()}
    for path in (Path(os.path.abspath(folder)), folder.resolve()):  # links, and where they lead
        for place, above in zip((path, *path.parents), path.parents, strict=False):
            mode = above.stat().st_mode
            is_kept_apart = mode & stat.S_ISVTX and place.lstat().st_uid in ours
            if mode & stat.S_IWOTH and not is_kept_apart:
                return True
    return bool(folder.stat().st_mode & stat.S_IWOTH)


def _temporary_parent() -> Path:
    """Return this user's folder in the temporary directory, or one for this process alone."""
    parent = Path(tempfile.gettempdir()) / f"agglom_mpi-{os.getuid()}"
    with suppress(OSError):
        with suppress(FileExistsError):
            parent.mkdir(mode=0o700)
        found = parent.lstat()
        is_private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o077
        if is_private and found.st_uid == os.geteuid():
            return parent
    alone = Path(tempfile.mkdtemp(prefix="agglom_mpi-"))
    atexit.register(shutil.rmtree, alone, ignore_errors=True)
    report_folder(parent, f"others can write there; this process keeps its own in {alone}")
    return alone


@functools.cache
def cache_folder() -> Path:
    """Return the folder of the compiled kernels of exactly these sources; create it if needed.

    `NUMBA_CACHE_DIR` names the parent folder if set, else `XDG_CACHE_HOME` or `~/.cache`; where
    that cannot be written, or where any user can, a private folder in the temporary directory. It
    begins as a copy of what was compiled in a folder that is closed to others.

    Raises
    ------
    OSError
        If no candidate can be written; names those tried.
    """
    key = sources_digest()[:16]
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    home = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    first = None
    with suppress(RuntimeError):  # a container may run as a user without a home
        first = Path(chosen) if chosen else Path(home).expanduser() / "agglom_mpi"
    is_usable = first is not None and _writable(first / key)
    is_shared = first is not None and (first / key).is_dir() and others_may_write(first / key)
    if first is not None and is_usable and not is_shared:
        return first / key
    parent = _temporary_parent()
    if first is not None and is_shared:
        report_folder(first, f"any user can write there; kept in {parent} instead")
    elif first is not None:
        _copy_folder(first / key, parent / key)
    if _writable(parent / key):
        return parent / key
    raise OSError(f"no writable folder for compiled kernels, tried: {first}, {parent}")


def kernel(function: F) -> F:
    """Compile a function that Python calls; cached on disk, runs without the GIL."""
    compiled: F = numba.njit(**_KERNEL)(function)
    if runs_compiled():
        compiled._cache = cache_of(function, cache_folder())  # type: ignore[attr-defined]
    return compiled


def as_plain(function: F) -> F:
    """Return a kernel as the Python function that it was compiled from."""
    return getattr(function, "py_func", function)


def compiled_stage(function: Callable[..., Any], manner: str) -> Any:
    """Return Numba's dispatcher of a stage; `manner` is a key of `STAGE_OPTIONS`."""
    return numba.njit(**STAGE_OPTIONS[manner])(function)


def replace(function: Callable[..., Any], choose: Callable[..., Any], manner: str) -> None:
    """Let kernels that call a function compile what `choose` returns for the arguments' types."""
    options: Any = STAGE_OPTIONS[manner]
    overload(function, strict=False, jit_options=options)(choose)


def runs_compiled() -> bool:
    """Return whether kernels are compiled, not run as plain Python to be debugged."""
    return not _CONFIG.DISABLE_JIT


def compile_ahead(compiled: Any, arguments: tuple[Any, ...]) -> bool:
    """Compile a kernel for arguments like these, or load it from the cache, and do not run it.

    The caller reports it: nothing is logged here. No reference cycles are looked for meanwhile,
    which takes a tenth of the time of a compiler.

    Returns
    -------
    bool
        Whether it was compiled.
    """
    misses = sum(compiled.stats.cache_misses.values())
    collecting = gc.isenabled()
    gc.disable()
    try:
        with _FIRST_CALLS.muted():
            compiled.compile(tuple(numba.typeof(argument) for argument in arguments))
    except Exception as error:  # Numba raises many kinds
        if (0, 62) <= numba.version_info.short <= (0, 68):
            raise
        raise ImportError(_NOT_TRIED, name="numba") from error
    finally:
        if collecting:
            gc.enable()
    return bool(sum(compiled.stats.cache_misses.values()) > misses)


class _FirstCalls(event.Listener):
    """Logs each kernel of the package that its first call compiles, which takes seconds."""

    def __init__(self) -> None:
        self._depth = 0

    def on_start(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        if not self._depth and function.__module__.startswith("agglom_mpi."):
            LOG.info("compiling the kernel %s", function.__name__)
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1

    @contextmanager
    def muted(self) -> Iterator[None]:
        """Log nothing within."""
        self._depth += 1
        try:
            yield
        finally:
            self._depth -= 1


_FIRST_CALLS: Final = _FirstCalls()
event.register("numba:compile", _FIRST_CALLS)


def code_key(sources: Iterable[Path]) -> str:
    """Return what Numba keeps the machine code of kernels in these files apart by, as text.

    That is its version, the processor, and the times at which the files were changed.
    """
    target = ll.get_host_cpu_name(), ll.get_host_cpu_features().flatten()
    changed = [path.stat().st_mtime_ns for path in sources]
    return f"{numba.__version__} {sys.version_info[:2]} {target} {changed}"


def _fused_instruction(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Return how Numba types and lowers a fused multiplication and addition."""

    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return numba.float64(numba.float64, numba.float64, numba.float64), lower


def _rounded_twice(a: float, b: float, c: float) -> float:
    return a * b + c


fused: Final[Any] = _rounded_twice if _CONFIG.DISABLE_JIT else intrinsic(_fused_instruction)
"""a·b + c, rounded once; twice where kernels run as plain Python.

It is written where it saves time, and not left to the compiler, whose choice depends on what else
it compiles.
"""


def _prefetch_instruction(typing_context: Any, array: Any, index: Any) -> Any:
    """Return how Numba types and lowers the prefetching of an item of an array of one axis."""
    # Imported here: a program that compiles nothing starts without them.
    from llvmlite import ir
    from numba.core import cgutils
    from numba.np.arrayobj import make_array

    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        values = make_array(array)(context, builder, arguments[0])
        whole = [context.cast(builder, arguments[1], index, numba.types.intp)]
        item = cgutils.get_item_pointer(context, builder, array, values, whole, wraparound=False)
        number, address = ir.IntType(32), builder.bitcast(item, ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [address.type, number, number, number])
        function = builder.module.declare_intrinsic("llvm.prefetch", [address.type], kind)
        read, keep, data = number(0), number(3), number(1)
        builder.call(function, [address, read, keep, data])
        return context.get_dummy_value()

    return numba.void(array, index), lower


def _read_when_used(array: Any, index: int) -> None:
    pass


prefetch: Final[Any] = _read_when_used if _CONFIG.DISABLE_JIT else intrinsic(_prefetch_instruction)
"""Begin to read item `index` of an array of one axis into the caches, and do not wait for it."""


stages.attach(sys.modules[__name__])
