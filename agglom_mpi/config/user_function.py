"""A user's objective function: its source is read beside the campaign, and run only if allowed.

The source of `module.py` is read once. Its bytes are sent with the campaign to all ranks, which
execute them in a module of their own; nothing is imported by path. A campaign read from a campaign
file knows only the digest, and cannot call the function.
"""

import hashlib
import math
import reprlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.declaration.own_modules import OwnModule, executed
from agglom_mpi.declaration.reading import SOURCE_SHA256, values_in
from agglom_mpi.declaration.spelling import MAX_MAGNITUDE
from agglom_mpi.declaration.users_code import users_code
from agglom_mpi.file_kinds import clipped, read_bounded

EMPTY_SHA256: Final = hashlib.sha256(b"").hexdigest()
"""Of a module without a source, which is known then."""

NUMBERS: Final = (float, int, np.floating, np.integer)
"""Types of what a function may return, but for bool."""


class UserFunction(NamedTuple):
    """A user's function.

    Attributes
    ----------
    call
        `module:function`.
    module
        The module; with no source where that is unknown: the function then cannot be called.
    """

    call: str
    module: OwnModule

    @property
    def without_source(self) -> "UserFunction":
        """The same function without its source, so that it cannot be called."""
        return UserFunction(self.call, self.module._replace(source=b"", folder=""))


def file_of(call: str) -> str:
    """Return the file name of the module of a function `module:function`."""
    return f"{call.partition(':')[0]}.py"


MAX_BYTES: Final = 1 << 20
"""Largest size of a module."""


def read_function(folder: Path, call: str) -> UserFunction:
    """Read and compile the source of a function's module, without executing it.

    Raises
    ------
    ValueError
        If there is no such file, or it is not Python.
    """
    file = file_of(call)
    return UserFunction(call, OwnModule.of(file, read_source(folder / file, call), folder))


def read_source(path: Path, named: str) -> bytes:
    """Return the source of a module that a campaign names as `named`; it is not executed.

    Raises
    ------
    ValueError
        If there is no such file, or it is not Python.
    """
    try:
        source = read_bounded(path, MAX_BYTES)
    except OSError as error:
        raise ValueError(f"is {named!r}, but {path} cannot be read: {error.strerror}") from None
    try:
        compile(source, path.name, "exec", dont_inherit=True)
    except (MemoryError, RecursionError):
        raise ValueError(f"is {named!r}, but {path}: is nested too deeply") from None
    except (SyntaxError, ValueError) as error:
        line = getattr(error, "lineno", None)
        place = f"{path}:{line}" if line else str(path)
        reason = clipped(getattr(error, "msg", error))
        raise ValueError(f"is {named!r}, but {place}: {reason}") from None
    return source


def recorded_function(identity: Mapping[str, Any]) -> UserFunction | None:
    """Return the function named by a stored campaign's identity, without source, or None."""
    call, digest = (identity.get(f"objective.{name}") for name in ("call", SOURCE_SHA256))
    if call is None or digest is None:
        return None
    values = values_in(identity, "objective") or None
    return UserFunction(str(call), OwnModule(file_of(str(call)), str(digest), b"", values=values))


@cache
def load_function(function: UserFunction) -> Callable[[Any], Any]:
    """Execute a module's source, once in each process, and return the function.

    Raises
    ------
    ValueError
        If the source is not known, cannot be executed, or defines no such function.
    """
    if not function.module.source and function.module.sha256 != EMPTY_SHA256:
        raise ValueError(f"the source of {function.call!r} is not known here")
    name = function.call.partition(":")[2]
    try:
        module = executed(function.module)
    except ValueError as error:
        raise ValueError(f"is {function.call!r}, but {error}") from error.__cause__
    loaded = getattr(module, name, None)
    if not callable(loaded):
        raise ValueError(
            f"is {function.call!r}, but {file_of(function.call)} defines no function {name!r}"
        )
    return loaded


@dataclass(frozen=True)
class FunctionOfMeans:
    """A user's function of the means of quantities, which can be sent to other ranks."""

    function: UserFunction

    def __call__(self, means: Mapping[str, Any]) -> Any:
        """Return its value, a finite float; it raises as `evaluate` does.

        Of arrays it returns what the function does.
        """
        call = self.function.call
        with users_code(call):
            value = load_function(self.function)(dict(means))
            if any(isinstance(mean, np.ndarray) for mean in means.values()):
                return np.asarray(value, np.float64)
            return _as_number(call, value)


def function_of_means(function: UserFunction | None, call: str) -> FunctionOfMeans | None:
    """Return the function `call` of the module of another function.

    It is None where there is no such function, or its source is not known.
    """
    if function is None or not function.module.source or not call:
        return None
    return FunctionOfMeans(function._replace(call=call))


def evaluate_quantities(
    function: UserFunction, sample: Any, names: Iterable[str]
) -> dict[str, float]:
    """Call a user's function with a finished sample; return the quantities that it returns.

    Parameters
    ----------
    function
    sample
        As for `evaluate`.
    names
        Names of the quantities, all of which must be returned and no others.

    Raises
    ------
    TypeError, ValueError
        If it does not return a mapping of these names alone to finite numbers.
    Exception
        Whatever the function raises; see `users_code`.
    """
    call, wanted = function.call, tuple(names)
    with users_code(call):
        value = load_function(function)(sample)
        found = dict(value) if isinstance(value, Mapping) else {}
        if found.keys() != set(wanted):
            said = f"{call} returned {reprlib.repr(value)}, of type {type(value).__name__}"
            must = f"must be a mapping of {', '.join(wanted)}, which objective.quantities names"
            raise ValueError(f"{said}; {must}, to numbers")
        return {name: _as_number(call, found[name], f" as {name}") for name in wanted}


def objective_alone(of_means: FunctionOfMeans, sample: Mapping[str, float]) -> float:
    """Return the objective of the quantities of one sample; nan where that has none.

    A logarithm or a ratio of means may not exist of a single sample. Other exceptions are faults
    of the function, and are passed on.
    """
    try:
        return float(of_means(sample))
    except (ArithmeticError, ValueError):
        return math.nan


def evaluate(function: UserFunction, sample: Any) -> float:
    """Call a user's function with a finished sample and return its value, a finite float.

    Raises
    ------
    TypeError, ValueError
        If it does not return a number, or one that is not finite or too large.
    Exception
        Whatever the function raises; see `users_code`.
    """
    with users_code(function.call):
        return _as_number(function.call, load_function(function)(sample))


def _as_number(call: str, value: Any, part: str = "") -> float:
    """Return what a function has returned; to look at it may run code of the user's, too."""
    if isinstance(value, bool) or not isinstance(value, NUMBERS):
        kind = type(value).__name__
        raise TypeError(
            f"{call} returned {reprlib.repr(value)}{part}, of type {kind}; must be a number, "
            "which float(...) makes of what stands for one"
        )
    number = as_float(value)
    if not (math.isfinite(number) and abs(number) <= MAX_MAGNITUDE):
        limit = f"must be finite, and in size at most {MAX_MAGNITUDE:g}"
        raise ValueError(f"{call} returned {reprlib.repr(value)}{part}; {limit}")
    return number


def as_float(number: Any) -> float:
    """Return a number of any of `NUMBERS` as a float, inf if it is too large."""
    try:
        return float(number)
    except OverflowError:
        return math.inf
