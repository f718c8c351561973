"""Compile and cache kernels, and choose the formulas of a scene by the types of its submodels.

Numba does not notice an edit in a file that a cached kernel only calls into, so the cache folder is
keyed by a hash of every source that can end up in a kernel.
"""

import functools
import gc
import hashlib
import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, TypeAlias, TypeVar

import llvmlite.binding as ll
import numba
from numba.core import event
from numba.extending import intrinsic, overload

from agglom_mpi.kernel_cache import cache_of
from agglom_mpi.kernel_linking import COMPILER

_PACKAGE: Final = Path(__file__).parent
_KERNEL_SOURCES: Final = (
    "kernel_indices.py",
    "kernel_linking.py",
    "kernels.py",
    "outcome.py",
    "physics/*.py",
    "simulation/**/*.py",
)

Submodel: TypeAlias = Any
"""A NamedTuple of the numbers of one law in SI units; its type says which law a scene has."""

_CONFIG: Any = numba.config
_KERNEL: Final[dict[str, Any]] = {
    "pipeline_class": COMPILER,
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "_nrt": True,
}
# Inlining saves copying the NamedTuples of arrays at every call: a factor of two and more.
_ALLOCATING: Final[dict[str, Any]] = {
    "pipeline_class": COMPILER,
    "nogil": True,
    "error_model": "numpy",
    "forceinline": True,
    "no_cfunc_wrapper": True,
    "no_cpython_wrapper": True,
    "_nrt": True,
}
# Without counting references to arrays, which costs more than half of the time of a short loop.
_INLINED: Final[dict[str, Any]] = {**_ALLOCATING, "_nrt": False}
_DISPATCHED: Final[Any] = {
    "pipeline_class": COMPILER,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "_nrt": False,
}

F = TypeVar("F", bound=Callable[..., Any])

LOG: Final = logging.getLogger(__name__)
"""Receives a line on each kernel that is compiled when it is first called."""


@functools.cache
def sources_digest() -> str:
    """Return a hash of all sources that decide what a sample computes: 64 hexadecimal digits."""
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


@functools.cache
def cache_folder() -> Path:
    """Return the folder of the compiled kernels of exactly these sources; create it if needed.

    `NUMBA_CACHE_DIR` names the parent folder if set, else `XDG_CACHE_HOME` or `~/.cache`; where
    that cannot be written, a folder of this user in the temporary directory, which begins as a copy
    of what was compiled there before.

    Raises
    ------
    OSError
        If no candidate can be written; names those tried.
    """
    key = sources_digest()[:16]
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    home = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    parents = [Path(chosen)] if chosen else [Path(home).expanduser() / "agglom_mpi"]
    parents.append(Path(tempfile.gettempdir()) / f"agglom_mpi-{os.getuid()}")
    for parent in parents:
        if parent is not parents[0]:
            _copy_folder(parents[0] / key, parent / key)
        if _writable(parent / key):
            return parent / key
    raise OSError(f"no writable folder for compiled kernels, tried: {', '.join(map(str, parents))}")


def kernel(function: F) -> F:
    """Compile a function that Python calls; cached on disk, runs without the GIL."""
    compiled: F = numba.njit(**_KERNEL)(function)
    if runs_compiled():
        compiled._cache = cache_of(function, cache_folder())  # type: ignore[attr-defined]
    return compiled


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


def inlined(function: F) -> F:
    """Compile a function that only kernels call and that makes no arrays; copied into its callers.

    It counts no references: the arrays it works on belong to the kernel. It cannot be called from
    Python.
    """
    compiled: F = numba.njit(**_INLINED)(function)
    return compiled


def not_inlined(function: F) -> F:
    """Compile a function like `inlined`, but called instead of copied: for what is done rarely.

    Copies are what compilation takes its time for.
    """
    compiled: F = numba.njit(**{**_INLINED, "forceinline": False})(function)
    return compiled


def inlined_allocating(function: F) -> F:
    """Compile a function like `inlined` that makes arrays, to return them or as work space."""
    compiled: F = numba.njit(**_ALLOCATING)(function)
    return compiled


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


class ANY:
    """Registers a function for every type of submodel without one of its own, except None."""


class Dispatcher:
    """A formula whose implementation is chosen by the type of a submodel when a kernel is compiled.

    Compiled code is specialised to the types, so a scene pays only for the laws that it has.
    """

    def __init__(self, signature: Callable[..., Any]) -> None:
        self.name = signature.__name__
        self.table: dict[type, Callable[..., Any]] = {}

    def register(self, *models: type | None) -> Callable[[F], F]:
        """Return a decorator that registers a function for these types of submodel.

        Parameters
        ----------
        models
            NamedTuple classes; `None` for a submodel that the scene leaves out; `ANY`.
        """

        def register(function: F) -> F:
            for model in models:
                self.table[type(None) if model is None else model] = function
            return function

        return register

    def of_numba_type(self, model: Any) -> Callable[..., Any] | None:
        """Return the function for a submodel given as a Numba type, None if there is none."""
        if isinstance(model, numba.types.NoneType):
            return self.table.get(type(None))
        found = getattr(model, "instance_class", object)
        return self.table.get(found) or self.table.get(ANY)

    def of(self, model: Any) -> Callable[..., Any]:
        """Return the function for a submodel; raises KeyError if there is none."""
        if model is not None and type(model) not in self.table:
            return self.table[ANY]
        return self.table[type(model)]


def dispatch(signature: Callable[..., Any]) -> Any:
    """Decorate a signature without a body: a formula dispatched on the type of its first argument.

    `signature.register(Law)` decorates what the law computes; see `Dispatcher`.
    """
    return _dispatched(signature, _DISPATCHED)


def dispatch_allocating(signature: Callable[..., Any]) -> Any:
    """Decorate a signature like `dispatch`; its functions may make arrays."""
    return _dispatched(signature, {**_DISPATCHED, "_nrt": True})


def _dispatched(signature: Callable[..., Any], options: Any) -> Any:
    dispatcher = Dispatcher(signature)

    @functools.wraps(signature)
    def dispatched(model: Any, *arguments: Any) -> Any:
        return dispatcher.of(model)(model, *arguments)

    @overload(dispatched, strict=False, jit_options=options)
    def choose(model: Any, *arguments: Any) -> Any:
        return dispatcher.of_numba_type(model)

    dispatched.register = dispatcher.register  # type: ignore[attr-defined]
    return dispatched


def optional_field(name: str) -> tuple[Any, Any]:
    """Return functions that get and set a field of a record, whose type may lack it.

    The first takes a record and what it returns where there is no such field; the second a record
    and the new value, which goes nowhere then. Compiled code is specialised to the type.
    """

    def value_or(record: Any, otherwise: Any) -> Any:
        return record[name] if name in record.dtype.names else otherwise

    def set_value(record: Any, value: Any) -> None:
        if name in record.dtype.names:
            record[name] = value

    @overload(value_or, strict=False, jit_options=_DISPATCHED)
    def choose_value(record: Any, otherwise: Any) -> Any:
        if name in record.fields:
            return lambda record, otherwise: record[name]
        return lambda record, otherwise: otherwise

    @overload(set_value, strict=False, jit_options=_DISPATCHED)
    def choose_setter(record: Any, value: Any) -> Any:
        def set_field(record: Any, value: Any) -> None:
            record[name] = value

        return set_field if name in record.fields else lambda record, value: None

    return value_or, set_value
