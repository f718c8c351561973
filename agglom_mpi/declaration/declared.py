"""Classes with declared fields, and how the values that a file gives them are read.

A subclass of `Declared` annotates its fields, with limits and meaning as metadata. Its instances
are immutable. `checked` reads given values, and names every field that is wrong; `recorded` takes
values that were checked before.
"""

import copyreg
from abc import ABCMeta
from collections.abc import Callable, Iterable, Iterator, Mapping
from math import isfinite
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Final,
    Literal,
    NamedTuple,
    Self,
    TypeAlias,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from agglom_mpi.declaration.own_modules import reduced_class
from agglom_mpi.declaration.reading import PLAIN, Reading
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.declaration.units import quoted

FieldPath: TypeAlias = tuple[str | int, ...]
"""Keys and list positions from the top of a file, or of a section, down to a field."""

Problems: TypeAlias = Iterable[tuple[FieldPath, str]]
"""Fields that are wrong: the path of each, and a message that follows its name."""

LATER: Final = "added later"
"""Metadata of a field added after version 0.1.0: at its default it is not in the identity."""


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


class Reads(NamedTuple):
    """Metadata of a field: a function that reads its value before the type is checked.

    `in_context` it is called with the `Reading`, too.
    """

    read: Callable[..., Any]
    in_context: bool = False

    def read_field(
        self, value: Any, kind: Any, reading: Reading, inner: Callable[[Any], Any]
    ) -> Any:
        """Return the value that the function returns, read by what stands before it."""
        return inner(self.read(value, reading) if self.in_context else self.read(value))


class Fits(NamedTuple):
    """Metadata of a field: a function of its value and the `Reading` that yields what is wrong."""

    problems: Callable[[Any, Reading], Problems]

    def read_field(
        self, value: Any, kind: Any, reading: Reading, inner: Callable[[Any], Any]
    ) -> Any:
        """Return the value that is read by what stands before it, and fits."""
        found = inner(value)
        raise_field_errors(self.problems(found, reading))
        return found


class Meaning(NamedTuple):
    """Metadata of a field: what it is, as a message states it where the field is missing."""

    meaning: str


MISSING: Final = object()
"""Default of a field that has none."""


class DeclaredField(NamedTuple):
    """A field: its type, the metadata of its annotation, and its default."""

    annotation: Any
    metadata: tuple[Any, ...]
    default: Any

    def is_required(self) -> bool:
        """Return whether there is no default."""
        return self.default is MISSING

    @property
    def meaning(self) -> str:
        """Meaning of the field; empty if its metadata do not state it."""
        stated = (getattr(each, "meaning", "") for each in self.metadata)
        return next(filter(None, stated), "")

    def read(self, value: Any, reading: Reading) -> Any:
        """Return the value of an entry of a file; raise a ValueError if it does not fit."""
        return read_value(value, self.annotation, self.metadata, reading)


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
    if isinstance(kind, type) and issubclass(kind, Declared) and not isinstance(value, kind):
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


class DeclaredType(ABCMeta):
    """Metaclass of what is declared; a class of one's own is pickled with its module."""


copyreg.pickle(DeclaredType, reduced_class)


@dataclass_transform(kw_only_default=True, frozen_default=True)
class Declared(metaclass=DeclaredType):
    """Base class of what is declared by annotated fields; equal where all fields are equal.

    Attributes
    ----------
    model_fields
        Fields by name.
    model_fields_set
        Names of the fields that were given.
    """

    model_fields: ClassVar[Mapping[str, DeclaredField]] = {}
    if TYPE_CHECKING:
        model_fields_set: ClassVar[frozenset[str]]

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.model_fields = {
            name: _field(cls, name, hint)
            for name, hint in get_type_hints(cls, include_extras=True).items()
            if not name.startswith(("_", "model_")) and get_origin(hint) is not ClassVar
        }

    def __init__(self, **values: Any) -> None:
        if values or any(field.is_required() for field in self.model_fields.values()):
            self.__dict__.update(self.checked(values).__dict__)
        else:
            self.__dict__.update(self._made({}).__dict__)

    @classmethod
    def checked(cls, values: Mapping[Any, Any], reading: Reading = PLAIN) -> Self:
        """Return the instance of given values.

        Fields are read in their order, and find those before them in `reading.earlier`.

        Raises
        ------
        FieldError
            If they do not fit; with all that is wrong.
        """
        values, wrong = cls.prepared(values, reading)
        problems, found = list(wrong), dict[str, Any]()
        within = reading._replace(earlier=found)
        for name, field in cls.model_fields.items():
            if name in values:
                try:
                    found[name] = field.read(values[name], within)
                except ValueError as error:
                    problems += problems_at(name, error)
            elif not field.is_required():
                found[name] = field.default
            else:
                message = "; ".join(filter(None, ["is missing", field.meaning]))
                problems.append(((name,), message))
        for key in values:
            if key not in cls.model_fields:
                advice = suggestion(str(key), cls.model_fields)
                problems.append(((key,), f"unknown key '{str(key)[:40]}'; {advice}"))
        raise_field_errors(problems)
        made = cls._made({name: found[name] for name in cls.model_fields if name in values})
        raise_field_errors(made.problems())
        return made

    @classmethod
    def prepared(
        cls, values: Mapping[Any, Any], reading: Reading
    ) -> tuple[Mapping[Any, Any], Problems]:
        """Return given values as their fields read them, and what is wrong with their keys."""
        return values, ()

    @classmethod
    def _made(cls, given: Mapping[str, Any]) -> Self:
        """Return the instance with given values and defaults, which are not checked."""
        made = cls.__new__(cls)
        for name, field in cls.model_fields.items():
            if name not in given and field.is_required():
                raise ValueError(f"{name} is missing")
            made.__dict__[name] = given.get(name, field.default)
        made.__dict__["model_fields_set"] = frozenset(given)
        return made

    @classmethod
    def recorded(cls, entries: Mapping[str, Any]) -> Self:
        """Return the instance of entries that were checked when they were recorded.

        Entries that are no fields are left out.
        """
        known = {name: value for name, value in entries.items() if name in cls.model_fields}
        for name, value in known.items():
            inner = next(declared_in(cls.model_fields[name].annotation), None)
            if inner is not None and isinstance(value, Mapping):
                known[name] = inner.recorded(value)
            elif get_origin(cls.model_fields[name].annotation) is tuple:
                known[name] = tuple(value)
        return cls._made(known)

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield fields that do not fit together: the path of each and what is wrong."""
        yield from ()

    def entries(self) -> Any:
        """Return all fields as plain values, without those marked `LATER` at their default."""
        return {
            name: plain(getattr(self, name))
            for name, field in self.model_fields.items()
            if LATER not in field.metadata or getattr(self, name) != field.default
        }

    def model_dump(self) -> dict[str, Any]:
        """Return all fields, and those of their values, by name."""
        return {k: v.model_dump() if isinstance(v, Declared) else v for k, v in self}

    def model_copy(self, *, update: Mapping[str, Any] | None = None) -> Self:
        """Return a copy with some fields replaced, which are not checked."""
        copy = self.__new__(type(self))
        kept = {name for name in self.__dict__ if name in self.model_fields or name[0] == "_"}
        copy.__dict__.update({name: self.__dict__[name] for name in kept}, **(update or {}))
        copy.__dict__["model_fields_set"] = self.model_fields_set | frozenset(update or {})
        return copy

    def __iter__(self) -> Iterator[tuple[str, Any]]:
        """Yield all fields by name, so that `dict(section)` has them."""
        return ((name, getattr(self, name)) for name in self.model_fields)

    def _values(self) -> tuple[Any, ...]:
        """Return what instances are compared by: fields, and what was bound to them."""
        kind, own = type(self), self.__dict__
        bound = sorted(k for k in own if k[0] == "_" and own[k] != getattr(kind, k, MISSING))
        return tuple(own[name] for name in (*self.model_fields, *bound))

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self._values() == other._values()

    def __hash__(self) -> int:
        return hash((type(self), self._values()))

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{type(self).__name__} is immutable; {name} cannot be set")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"{type(self).__name__} is immutable; {name} cannot be deleted")

    def __repr__(self) -> str:
        fields = ", ".join(f"{name}={value!r}" for name, value in self)
        return f"{type(self).__name__}({fields})"


def _field(cls: type, name: str, hint: Any) -> DeclaredField:
    """Return a field, whose default stands where it is annotated or given anew."""
    metadata = getattr(hint, "__metadata__", ())
    for base in cls.__mro__:
        if name in vars(base) or name in vars(base).get("__annotations__", ()):
            default = vars(base).get(name, MISSING)
            return DeclaredField(hint.__origin__ if metadata else hint, metadata, default)
    raise AssertionError(name)


def declared_in(annotation: Any) -> Iterator[type[Declared]]:
    """Yield the classes of `Declared` that a type names."""
    if isinstance(annotation, type) and issubclass(annotation, Declared):
        yield annotation
    for inner in get_args(annotation):
        yield from declared_in(inner)


def plain(value: Any) -> Any:
    """Return a value with all sections in it as plain values."""
    if hasattr(value, "entries"):
        return value.entries()
    if isinstance(value, dict):
        return {key: plain(inner) for key, inner in value.items()}
    return [plain(inner) for inner in value] if isinstance(value, list | tuple) else value
