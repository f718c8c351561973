"""Declare the stages of kernels and the formulas of laws, without loading the compiler.

A law is declared in one class, which `agglom check` reads too: Numba, which takes half a second to
load, is imported when the first kernel is declared, and the stages declared until then are given to
it.
"""

import functools
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, TypeAlias, TypeVar

Submodel: TypeAlias = Any
"""A NamedTuple of the numbers of one law in SI units; its type says which law a scene has."""

F = TypeVar("F", bound=Callable[..., Any])
R = TypeVar("R")

AS_PLAIN_PYTHON: Final = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
"""Whether kernels run as plain Python, to be debugged."""

OWN_PREFIX: Final = "agglom_own_"
"""Beginning of the names of modules of one's own, whose laws kernels may be compiled for."""


def module_key(name: str) -> str:
    """Return the name of a module; of one's own with the values that it has read."""
    found: str = (
        getattr(sys.modules.get(name), "key", name) if name.startswith(OWN_PREFIX) else name
    )
    return found


_LAWS: Final[dict[type, type]] = {}
_WAITING: Final[list[Callable[[Any], None]]] = []
_COMPILERS: Final[list[Any]] = []
_FORMULAS: Final[list[tuple[type, str, Callable[..., Any]]]] = []


def declare_numbers(numbers: type, law: type) -> None:
    """State that a NamedTuple holds the numbers of a law, a class with formulas as methods."""
    _LAWS[numbers] = law


def law_of(numbers: Any) -> Any:
    """Return the law whose numbers these are."""
    return _LAWS[type(numbers)]


def laws_in(models: Iterable[Any]) -> Iterator[Any]:
    """Yield those of several submodels that are the numbers of a law, and of laws within these."""
    for model in models:
        if type(model) in _LAWS:
            yield model
            yield from laws_in(model)


def formulas_of(law: type) -> dict[str, Callable[..., Any]]:
    """Return the formulas of a law's kind by name: the methods of its base classes."""
    return {name: method for kind, name, method in _FORMULAS if issubclass(law, kind)}


def attach(compiler: Any) -> None:
    """Give all stages declared so far, and later ones at once, to the module of the compiler."""
    _COMPILERS.append(compiler)
    for declare in _WAITING:
        declare(compiler)
    _WAITING.clear()


def compiler_is_loaded() -> bool:
    """Return whether a kernel has been declared, for which the compiler is loaded."""
    return bool(_COMPILERS)


def _give(declare: Callable[[Any], None]) -> None:
    if _COMPILERS:
        declare(_COMPILERS[0])
    else:
        _WAITING.append(declare)


class Stage:
    """A function that kernels call, compiled when the first kernel calls it.

    Called from Python it runs as plain Python.

    Parameters
    ----------
    function
        The function.
    manner
        How it is compiled: a key of `kernels.STAGE_OPTIONS`.
    """

    def __init__(self, function: Callable[..., Any], manner: str) -> None:
        functools.update_wrapper(self, function)
        self.py_func = function
        self.manner = manner

    def __call__(self, *arguments: Any) -> Any:
        """Run the function as plain Python."""
        return self.py_func(*arguments)

    @functools.cached_property
    def compiled(self) -> Any:
        """Numba's dispatcher of the function; there is one once a kernel has been declared."""
        return _COMPILERS[0].compiled_stage(self.py_func, self.manner)

    @property
    def _numba_type_(self) -> Any:
        """Type by which Numba knows the stage in a kernel."""
        return self.compiled._numba_type_


def _stage(function: F, manner: str) -> F:
    if AS_PLAIN_PYTHON:
        return function
    stage: Any = Stage(function, manner)
    return stage


def inlined(function: F) -> F:
    """Compile a function that only kernels call and that makes no arrays; copied into its callers.

    It counts no references: the arrays it works on belong to the kernel.
    """
    return _stage(function, "inlined")


def not_inlined(function: F) -> F:
    """Compile a function like `inlined`, but called instead of copied: for what is done rarely.

    Copies are what compilation takes its time for.
    """
    return _stage(function, "not inlined")


def inlined_allocating(function: F) -> F:
    """Compile a function like `inlined` that makes arrays, to return them or as work space."""
    return _stage(function, "allocating")


class ANY:
    """Registers a function for every type of submodel without one of its own, except None."""


class Dispatcher:
    """A formula whose implementation is chosen by the type of a submodel when a kernel is compiled.

    Compiled code is specialised to the types, so a scene pays only for the laws that it has. The
    implementation is a function registered for the type or for its law, or else the law's method of
    this name.

    Parameters
    ----------
    name
        Name of the formula.
    kind
        Base class of the laws whose method it is; None if functions are registered.
    """

    def __init__(self, name: str, kind: Any = None) -> None:
        self.name = name
        self.kind = kind
        self.table: dict[type, Callable[..., Any]] = {}
        self._absent: Callable[..., Any] | None = None

    def register(self, *models: type | None) -> Callable[[F], F]:
        """Return a decorator that registers a function for these types of submodel.

        Parameters
        ----------
        models
            NamedTuple classes or laws; `None` for a submodel that the scene leaves out; `ANY`.
        """

        def register(function: F) -> F:
            for model in models:
                self.table[type(None) if model is None else model] = function
            return function

        return register

    def of_type(self, model: type) -> Callable[..., Any] | None:
        """Return the function for a type of submodel, None if there is none."""
        if model in self.table:
            return self.table[model]
        if model is type(None):
            if self._absent is None and self.kind is not None:
                self._absent = self._method(self.kind.absent())
            return self._absent
        law = _LAWS.get(model, model)
        registered = (self.table[base] for base in law.__mro__ if base in self.table)
        return next(registered, None) or self._method(law) or self.table.get(ANY)

    def _method(self, law: type) -> Callable[..., Any] | None:
        if self.kind is None or not issubclass(law, self.kind):
            return None
        method: Callable[..., Any] = getattr(law, self.name)
        return method

    def __call__(self, model: Any, *arguments: Any) -> Any:
        """Evaluate the formula; raises a TypeError if the submodel has none."""
        function = self.of_type(type(model))
        if function is None:
            raise TypeError(f"{type(model).__name__} has no {self.name}")
        return function(model, *arguments)


def dispatch(signature: Callable[..., Any]) -> Any:
    """Decorate a signature without a body: a formula dispatched on the type of its first argument.

    `signature.register(Law)` decorates what the law computes; see `Dispatcher`.
    """
    return _dispatched(signature, "dispatched")


def dispatch_allocating(signature: Callable[..., Any]) -> Any:
    """Decorate a signature like `dispatch`; its functions may make arrays."""
    return _dispatched(signature, "dispatched, allocating")


def formula(kind: Any, method: Callable[..., R]) -> Callable[..., R]:
    """Return the function of kernels that evaluates a method of whichever law a scene has.

    Parameters
    ----------
    kind
        Base class of the laws.
    method
        Its method: the signature, and what it computes unless a law says otherwise.
    """
    _FORMULAS.append((kind, method.__name__, method))
    found: Callable[..., R] = _dispatched(method, "dispatched", kind)
    return found


def _dispatched(signature: Callable[..., Any], manner: str, kind: Any = None) -> Any:
    dispatcher = Dispatcher(signature.__name__, kind)

    @functools.wraps(signature)
    def dispatched(model: Any, *arguments: Any) -> Any:
        return dispatcher(model, *arguments)

    def of_numba_type(model: Any, *arguments: Any) -> Any:
        return dispatcher.of_type(_python_type(model))

    _give(lambda compiler: compiler.replace(dispatched, of_numba_type, manner))
    dispatched.register = dispatcher.register  # type: ignore[attr-defined]
    return dispatched


def _python_type(model: Any) -> type:
    """Return the Python type of a submodel given as a Numba type."""
    if str(model) == "none":
        return type(None)
    found: type = model.instance_class
    return found


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

    def choose_value(record: Any, otherwise: Any) -> Any:
        if name in record.fields:
            return lambda record, otherwise: record[name]
        return lambda record, otherwise: otherwise

    def choose_setter(record: Any, value: Any) -> Any:
        def set_field(record: Any, value: Any) -> None:
            record[name] = value

        return set_field if name in record.fields else lambda record, value: None

    _give(lambda compiler: compiler.replace(value_or, choose_value, "dispatched"))
    _give(lambda compiler: compiler.replace(set_value, choose_setter, "dispatched"))
    return value_or, set_value
