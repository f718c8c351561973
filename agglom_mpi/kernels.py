"""How kernels are compiled, where their machine code is cached, and how formulas are chosen.

Numba does not notice an edit in a file that a cached kernel only calls into, so the cache folder is
keyed by a hash of every source that can end up in a kernel.
"""

import functools
import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeAlias, TypeVar

import numba
from numba.extending import overload

_PACKAGE: Final = Path(__file__).parent
_KERNEL_SOURCES: Final = ("kernels.py", "outcome.py", "physics/*.py", "simulation/**/*.py")

Submodel: TypeAlias = Any
"""A NamedTuple of numbers that says by its type which law a scene has."""

_CONFIG: Any = numba.config
_KERNEL: Final[dict[str, Any]] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "_nrt": True,
}
# Inlining saves copying the NamedTuples of arrays at every call: a factor of two and more.
_ALLOCATING: Final[dict[str, Any]] = {
    "nogil": True,
    "error_model": "numpy",
    "forceinline": True,
    "no_cfunc_wrapper": True,
    "no_cpython_wrapper": True,
    "_nrt": True,
}
# Without counting references to arrays, which costs more than half of the time of a short loop.
_STAGE: Final[dict[str, Any]] = {**_ALLOCATING, "_nrt": False}

F = TypeVar("F", bound=Callable[..., Any])


@functools.cache
def sources_digest() -> str:
    """Hash of all sources that decide what a sample computes, as 64 hexadecimal digits."""
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


@functools.cache
def cache_folder() -> Path:
    """Folder of the compiled kernels of exactly these sources; made, and known to be writable.

    `NUMBA_CACHE_DIR` names the parent folder if set, else `XDG_CACHE_HOME` or `~/.cache`; where
    that cannot be written, a folder of this user in the temporary directory.
    """
    key = sources_digest()[:16]
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    home = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    parents = [Path(chosen)] if chosen else [Path(home).expanduser() / "agglom_mpi"]
    parents.append(Path(tempfile.gettempdir()) / f"agglom_mpi-{os.getuid()}")
    for parent in parents:
        if _writable(parent / key):
            return parent / key
    raise OSError(f"no writable folder for compiled kernels, tried: {', '.join(map(str, parents))}")


def kernel(function: F) -> F:
    """Compile a function that Python calls: cached on disk, without the GIL."""
    if not _CONFIG.DISABLE_JIT:
        _CONFIG.CACHE_DIR = str(cache_folder())
    compiled: F = numba.njit(**_KERNEL)(function)
    return compiled


def inlined(function: F) -> F:
    """Compile a function that only kernels call and that makes no arrays.

    The arrays it works on belong to the kernel. It has no code to be called from Python.
    """
    compiled: F = numba.njit(**_STAGE)(function)
    return compiled


def not_inlined(function: F) -> F:
    """Compile a stage that is done rarely, and so is not copied into every place that calls it.

    Copies are what compilation takes its time for.
    """
    compiled: F = numba.njit(**{**_STAGE, "forceinline": False})(function)
    return compiled


def inlined_fma(function: F) -> F:
    """Compile a stage in which a product and a sum may be rounded once instead of twice."""
    compiled: F = numba.njit(**_STAGE, fastmath={"contract"})(function)
    return compiled


def inlined_allocating(function: F) -> F:
    """Compile a stage that makes arrays, to return or to use for itself."""
    compiled: F = numba.njit(**_ALLOCATING)(function)
    return compiled


class ANY:
    """Stands for every type of submodel that nothing else is registered for, but not for None."""


class Dispatcher:
    """A formula that is chosen by the type of one submodel, when a kernel is compiled.

    Used as a decorator on a signature without a body; `register` adds what a type of submodel (a
    NamedTuple class, `None` for one that the scene leaves out, or `ANY`) computes. Compiled code is
    specialised to the types, so a scene pays only for what it has.
    """

    def __init__(self, signature: Callable[..., Any]) -> None:
        self.name = signature.__name__
        self.table: dict[type, Callable[..., Any]] = {}

    def register(self, *models: type | None) -> Callable[[F], F]:
        """Register the decorated function for these types of submodel."""

        def register(function: F) -> F:
            for model in models:
                self.table[type(None) if model is None else model] = function
            return function

        return register

    def of_numba_type(self, model: Any) -> Callable[..., Any] | None:
        """Return the function of a submodel given as a Numba type."""
        if isinstance(model, numba.types.NoneType):
            return self.table.get(type(None))
        found = getattr(model, "instance_class", object)
        return self.table.get(found) or self.table.get(ANY)

    def of(self, model: Any) -> Callable[..., Any]:
        """Return the function of a submodel; raises KeyError if there is none."""
        if model is not None and type(model) not in self.table:
            return self.table[ANY]
        return self.table[type(model)]


def dispatch(signature: Callable[..., Any]) -> Any:
    """Make `signature` a formula dispatched on the type of its first argument; see `Dispatcher`."""
    return _ask(signature, {"error_model": "numpy", "_nrt": False})


def dispatch_allocating(signature: Callable[..., Any]) -> Any:
    """Make a formula like `dispatch`, whose functions may make arrays for themselves."""
    return _ask(signature, {"error_model": "numpy", "_nrt": True})


def _ask(signature: Callable[..., Any], options: Any) -> Any:
    table = Dispatcher(signature)

    @functools.wraps(signature)
    def ask(model: Any, *arguments: Any) -> Any:
        return table.of(model)(model, *arguments)

    @overload(ask, strict=False, jit_options=options)
    def choose(model: Any, *arguments: Any) -> Any:
        return table.of_numba_type(model)

    ask.register = table.register  # type: ignore[attr-defined]
    return ask
