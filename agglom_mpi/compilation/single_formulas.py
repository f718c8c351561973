"""Compile one formula of a law alone, and state in one line what Numba cannot compile.

Numba reports an error within a kernel with every call that leads to it, and with every
implementation that did not fit. A formula that is compiled alone, for arguments of its kind, gives
the error where it is made: the innermost line of the law's own file, and what is wrong there.
"""

import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple, get_args, get_origin, get_type_hints

import numba
from numba.core import types

from agglom_mpi.compilation.stages import OWN_PREFIX

_PLACES: Final = re.compile(
    r'File "(?P<file>[^"]+)", line (?P<line>\d+)|(?:at|from) (\S+) \((\d+)\)'
)
_STEP: Final = re.compile(r"\s*(\w+: )?Failed in \w+ mode pipeline \(step: .*\)")
_UNKNOWN_CALL: Final = re.compile(r"No implementation of function Function\(<.*?(\w+)( at .*)?>\)")
_OWN_TYPE: Final = re.compile(rf"{OWN_PREFIX}\w+?_[0-9a-f]{{16}}_")
"""Prefix of the name of a class in the types of its numbers."""
_ALLOCATES: Final = "NRT required but not enabled"

_OPTIONS: Final[dict[str, Any]] = {"error_model": "numpy", "_nrt": False, "nogil": True}
"""Options of Numba: those of stages that make no arrays, but called from Python.

A formula that does not end is noticed by another thread.
"""

LONGEST_REASON: Final = 300
"""Maximum number of characters of a reason."""


class Place(NamedTuple):
    """A line of a source file."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{Path(self.file).name}:{self.line}"


class UncompiledFormulaError(Exception):
    """A formula that Numba cannot compile, or that returns something else than its kind does."""

    def __init__(self, place: Place, reason: str) -> None:
        super().__init__(f"{place}: {reason}")


def compile_alone(
    method: Callable[..., Any], base: Callable[..., Any], arguments: tuple[Any, ...]
) -> Callable[..., Any]:
    """Compile a formula of a law, and return it for calls from Python.

    Parameters
    ----------
    method
        The formula.
    base
        The same formula of the base class of its kind, whose annotations state what it returns.
    arguments
        Arguments of the types that kernels call it with.

    Raises
    ------
    UncompiledFormulaError
        If it cannot be compiled, takes other arguments, or returns something else.
    """
    start = Place(method.__code__.co_filename, method.__code__.co_firstlineno)
    _check_arguments(method, base, arguments, start)
    compiled: Any = numba.njit(**_OPTIONS)(method)
    try:
        compiled.compile(tuple(numba.typeof(argument) for argument in arguments))
    except MemoryError:
        raise
    except Exception as error:  # Numba raises many kinds, and not all are its own
        raise UncompiledFormulaError(*_reading(str(error), start)) from error
    (overload,) = compiled.overloads.values()
    returned, wanted = overload.signature.return_type, get_type_hints(base).get("return", Any)
    if not _is_of(returned, wanted):
        text = f"{method.__name__} returns {returned}; must return {_named(wanted)}"
        raise UncompiledFormulaError(start, text)
    formula: Callable[..., Any] = compiled
    return formula


def _check_arguments(
    method: Callable[..., Any], base: Callable[..., Any], arguments: tuple[Any, ...], start: Place
) -> None:
    """Raise an UncompiledFormulaError if a formula cannot be called with these arguments."""
    try:
        inspect.signature(method).bind(*arguments)
    except TypeError:
        wanted, given = inspect.signature(base), inspect.signature(method)
        names = ", ".join(wanted.parameters)
        reason = f"{method.__name__} takes ({', '.join(given.parameters)}); must take ({names})"
        raise UncompiledFormulaError(start, reason) from None


def _reading(text: str, start: Place) -> tuple[Place, str]:
    """Return the innermost place in the file of `start` that an error of Numba names, and why."""
    lines = text.splitlines()
    for number, place in _places(lines):
        if place.file == start.file:
            return place, _reason(lines[: max(number, 1)], _indent(lines[number]))
    return start, _reason(lines, _indent(lines[0]) if lines else 0)


def _places(lines: list[str]) -> Iterator[tuple[int, Place]]:
    for number, line in enumerate(lines):
        for found in _PLACES.finditer(line):
            file, at, other, line_there = found.groups()
            yield number, Place(file or other, int(at or line_there))


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def _reason(lines: list[str], indent: int) -> str:
    """Return the message of the error whose place is indented by so many characters, shortened."""
    if any(_ALLOCATES in line for line in lines):
        return "needs memory of its own (an array, list, dict or text), which no formula may make"
    heads = [
        number
        for number, line in enumerate(lines)
        if not _STEP.match(line)
        and line.strip()
        and (number == 0 or _STEP.match(lines[number - 1]))
        and _indent(line) == indent
    ]
    first = heads[-1] if heads else 0
    text = lines[first].strip() if lines else "cannot be compiled"
    if found := _UNKNOWN_CALL.match(text):
        calls = (line.strip() for line in lines[first:] if line.strip().startswith(">>> "))
        call = next(calls, found.group(1))
        text = f"Numba cannot compile {call.removeprefix('>>> ')}"
    text = _OWN_TYPE.sub("", re.sub(r"\.*\s*(Raised from .*)?$", "", text))
    return text if len(text) <= LONGEST_REASON else f"{text[: LONGEST_REASON - 3]}..."


def _is_of(returned: Any, wanted: Any) -> bool:
    """Return whether a type of Numba is what an annotation states; a number may be whole."""
    if wanted is float:
        return isinstance(returned, types.Number) and not isinstance(returned, types.Complex)
    if wanted in (bool, int):
        kinds = (types.Boolean, types.BooleanLiteral) if wanted is bool else (types.Integer,)
        return isinstance(returned, kinds)
    if wanted in (None, type(None)):
        return isinstance(returned, types.NoneType)
    if get_origin(wanted) is tuple:
        parts = get_args(wanted)
        fits = isinstance(returned, types.BaseTuple) and len(returned) == len(parts)
        return fits and all(map(_is_of, tuple(returned), parts))
    if isinstance(wanted, type) and issubclass(wanted, tuple):
        same = isinstance(returned, types.BaseTuple) and _class_of(returned) is wanted
        return same and all(map(_is_of, tuple(returned), get_type_hints(wanted).values()))
    return True


def _class_of(returned: Any) -> type | None:
    """Return the class of a NamedTuple by its type; None of other tuples."""
    named = isinstance(returned, types.BaseNamedTuple)
    return returned.instance_class if named else None


def _named(wanted: Any) -> str:
    return wanted.__name__ if isinstance(wanted, type) and not get_args(wanted) else str(wanted)
