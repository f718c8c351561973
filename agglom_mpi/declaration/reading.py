"""How the text of a campaign is read: as it is today or was recorded, and with which own classes.

Whoever maps the name of a component to its class, such as `components.class_named`, asks a
`Reading` for the classes of one's own.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from math import isfinite
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Final,
    Literal,
    NamedTuple,
    TypeAlias,
    TypeGuard,
    Union,
    get_args,
    get_origin,
)

from agglom_mpi.declaration.units import quoted
from agglom_mpi.variables import TEN, VariableTable

FieldPath: TypeAlias = tuple[str | int, ...]
"""Keys and list positions from the top of a file, or of a section, down to a field."""

Problems: TypeAlias = Iterable[tuple[FieldPath, str]]
"""Fields that are wrong: the path of each, and a message that follows its name."""


class FieldError(ValueError):
    """Errors of fields, each with its path below the validated section."""

    def __init__(self, *problems: tuple[FieldPath, str]) -> None:
        super().__init__("; ".join(f"{'.'.join(map(str, path))}: {m}" for path, m in problems))
        self.problems = problems


def raise_field_errors(problems: Problems) -> None:
    """Raise a FieldError unless there are no problems."""
    found = list(problems)
    if found:
        raise FieldError(*found)


OWN_NAME: Final = re.compile(r"([^\W\d]\w*)\.py:([^\W\d]\w*)")
"""Regular expression of the name of a component of one's own, `FILE.py:Class`."""

SOURCE_SHA256: Final = "source_sha256"
"""Entry of an identity with the digest of code of one's own, beside those of its section."""

SOURCE_VALUES: Final = "source_values"
"""Entry of an identity with the values that this code has read, where there are some."""

OWN_MODULES: Final = "own_modules"
"""Name of the text, JSON, with the modules of one's own of a file."""
OWN_COMPONENTS: Final = "own_components"
"""Name of a text of files of earlier versions, which described the classes of these modules."""
OWN_SHA256: Final = "own_sha256"
"""Name of the SHA-256 of these two, one after the other, hexadecimal."""


ONLY_BESIDE: Final = "which is read beside a campaign file; this text has none"


def names_own(name: object) -> TypeGuard[str]:
    """Return whether a name is meant for a component of one's own: it holds the end of a file."""
    return isinstance(name, str) and ".py" in name


def own_names(identity: Mapping[str, Any]) -> dict[str, str]:
    """Return the components of one's own of an identity by section: `scene.friction`."""
    named = {entry.rpartition(".")[0]: name for entry, name in identity.items() if names_own(name)}
    return {
        section: name
        for section, name in named.items()
        if OWN_NAME.fullmatch(name) and f"{section}.{SOURCE_SHA256}" in identity
    }


def values_in(identity: Mapping[str, Any], section: str) -> tuple[tuple[str, str], ...]:
    """Return the values that the code of a section of an identity has read, by name."""
    start = f"{section}.{SOURCE_VALUES}."
    return tuple(
        sorted((k.removeprefix(start), str(v)) for k, v in identity.items() if k.startswith(start))
    )


class OwnComponents:
    """Finds the classes of a campaign's own components; this one finds none."""

    def find(self, name: str, kind: type[Any]) -> type[Any]:
        """Return the class `FILE.py:Class`, which should be one of a kind.

        Raises
        ------
        ValueError
            If there is none, or its code may not run; with the reason.
        """
        raise ValueError(f"is {quoted(name)}, {ONLY_BESIDE}")


NO_OWN: Final = OwnComponents()
"""Finds none."""


class NamedFiles:
    """Reads the files of sizes and impacts that a campaign names; this one reads none."""

    def diameters(self, name: str, keys: Any) -> dict[str, Any]:
        """Return what a law of sizes reads from its file, by field; `keys` are those of a curve.

        Raises
        ------
        ValueError
            If it cannot be read, with the reason.
        """
        raise ValueError(f"is {quoted(name)}, {ONLY_BESIDE}")

    def curve(self, place: int, name: str, keys: Any) -> Any:
        """Return the size distribution of a file, which the section `data` names.

        `place` is the number of the entry, from 0, and `keys` what it states of the file. Raises a
        ValueError if that cannot be read, with the reason.
        """
        raise ValueError(f"is {quoted(name)}, {ONLY_BESIDE}")

    def impacts(self, place: int, name: str, keys: Any) -> Any:
        """Return the impacts of a file; arguments and errors as of `curve`."""
        raise ValueError(f"is {quoted(name)}, {ONLY_BESIDE}")

    def of_experiment(self, name: str) -> "NamedFiles":
        """Return what reads the files that an experiment names."""
        return self


NO_FILES: Final = NamedFiles()
"""Reads none."""


class Reading(NamedTuple):
    """How the text of a campaign is read.

    Attributes
    ----------
    recorded
        Whether a run has recorded the text, which is then read as it was, also where it is refused
        today.
    own
        Finds the components of one's own that it names.
    variables
        Variables of its strings.
    files
        Reads the files of sizes.
    search_method
        Search method of a recorded campaign whose text may name none; empty: today's default.
    earlier
        Fields of the mapping that is read which stand before the field, where they are right.
    """

    recorded: bool = False
    own: OwnComponents = NO_OWN
    variables: VariableTable = TEN
    files: NamedFiles = NO_FILES
    search_method: str = ""
    earlier: Mapping[str, Any] = {}


PLAIN: Final = Reading()
"""Reading of a text alone."""


def read_value(value: Any, kind: Any, metadata: tuple[Any, ...], reading: Reading) -> Any:
    """Return a value as a type and its metadata read it, the last of these first.

    Raises
    ------
    FieldError
        If values within it do not fit.
    ValueError
        If it does not fit itself; the message follows the name of the field.
    """
    if not metadata:
        return _of_type(value, kind, reading)
    *before, last = metadata

    def inner(found: Any) -> Any:
        return read_value(found, kind, tuple(before), reading)

    if not hasattr(last, "read_field"):
        return inner(value)
    return last.read_field(value, kind, reading, inner)


_EXPECTED: Final = {
    int: "a whole number",
    float: "a number",
    str: "a text; put it in quotes",
    bool: "true or false",
    dict: "a mapping",
    list: "a list",
    tuple: "a list",
}


def _of_type(value: Any, kind: Any, reading: Reading) -> Any:
    """Return a value of a type, which reads the values within it."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return read_value(value, kind.__origin__, kind.__metadata__, reading)
    if origin in (Union, UnionType):
        return _of_one_type(value, inner, reading)
    if origin is Literal:
        if not any(value == each and type(value) is type(each) for each in inner):
            raise ValueError(f"is {quoted(value)}; allowed: {', '.join(map(str, inner))}")
        return value
    if origin in (tuple, list):
        return origin(_entries(value, origin, inner, reading))
    if origin is dict:
        known = _instance(value, dict)
        return dict(_read_all(((key, each, inner[1]) for key, each in known.items()), reading))
    if hasattr(kind, "checked") and not isinstance(value, kind):  # it is declared
        return kind.checked(_instance(value, dict), reading)
    return value if kind is Any else _instance(value, kind)


def _of_one_type(value: Any, kinds: tuple[Any, ...], reading: Reading) -> Any:
    if value is None and NoneType in kinds:
        return None
    *others, last = (kind for kind in kinds if kind is not NoneType)
    for kind in others:
        try:
            return _of_type(value, kind, reading)
        except ValueError:
            continue
    return _of_type(value, last, reading)


def _entries(value: Any, origin: Any, kinds: tuple[Any, ...], reading: Reading) -> Iterator[Any]:
    """Yield the values of a list, all of one type or each of its own."""
    known = list(value) if isinstance(value, tuple) else _instance(value, list)
    if origin is list or Ellipsis in kinds:
        kinds = (kinds[0],) * len(known)
    if len(known) != len(kinds):
        raise ValueError(f"is {quoted(value)}; must have {len(kinds)} entries")
    entries = ((i, *each) for i, each in enumerate(zip(known, kinds, strict=True)))
    return (found for _, found in _read_all(entries, reading))


def _read_all(
    entries: Iterable[tuple[str | int, Any, Any]], reading: Reading
) -> list[tuple[str | int, Any]]:
    """Return the values of entries, each a key, a value and its type, by key."""
    found, problems = [], list[tuple[FieldPath, str]]()
    for key, value, kind in entries:
        try:
            found.append((key, _of_type(value, kind, reading)))
        except ValueError as error:
            problems += problems_at(key, error)
    raise_field_errors(problems)
    return found


def problems_at(key: str | int, error: ValueError) -> Iterator[tuple[FieldPath, str]]:
    """Yield what is wrong with a field, or with those within it."""
    if isinstance(error, FieldError):
        yield from (((key, *path), message) for path, message in error.problems)
    else:
        yield (key,), str(error)


def _instance(value: Any, kind: Any) -> Any:
    """Return a value that is an instance of a type; raise a ValueError otherwise."""
    is_number = kind is float and isinstance(value, int)
    is_flag = isinstance(value, bool) and kind is not bool
    if is_flag or not (is_number or isinstance(value, kind)):
        raise ValueError(f"is {quoted(value)}; must be {_EXPECTED.get(kind, kind.__name__)}")
    if kind is float and not isfinite(value):
        raise ValueError(f"is {quoted(value)}; must be a finite number")
    return float(value) if is_number else value
