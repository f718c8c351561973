"""Classes with declared fields, and how the values that a file gives them are read.

A subclass of `Declared` annotates its fields, with limits and meaning as metadata. Its instances
are immutable. `checked` reads given values, and names every field that is wrong; `recorded` takes
values that were checked before.
"""

import copyreg
import inspect
import re
from abc import ABCMeta
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Final,
    NamedTuple,
    Self,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from agglom_mpi.declaration.own_modules import reduced_class
from agglom_mpi.declaration.reading import PLAIN, Reading, problems_at, read_value
from agglom_mpi.declaration.reading import FieldError as FieldError
from agglom_mpi.declaration.reading import FieldPath as FieldPath
from agglom_mpi.declaration.reading import Problems as Problems
from agglom_mpi.declaration.reading import raise_field_errors as raise_field_errors
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.declaration.units import quoted

LATER: Final = "added later"
"""Metadata of a field added after version 0.1.0: at its default it is not in the identity."""


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
    """Metadata of a field: a function of its value and the `Reading` that yields what is wrong.

    It is asked where the fields `beside` it are among `Reading.earlier`.
    """

    problems: Callable[[Any, Reading], Problems]
    beside: tuple[str, ...] = ()

    def read_field(
        self, value: Any, kind: Any, reading: Reading, inner: Callable[[Any], Any]
    ) -> Any:
        """Return the value that is read by what stands before it, and fits."""
        found = inner(value)
        if reading.earlier.keys() >= set(self.beside):
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


ATTRIBUTES: Final = re.compile(r"\n\nAttributes\n-+\n")
"""Heading of the part of a docstring that describes fields."""
_ENTRY: Final = re.compile(r"^(\w[\w, ]*)\n((?:    .*(?:\n|$)|\n(?=    ))*)", re.MULTILINE)


def meaning_of(section: type[Any], name: str) -> str:
    """Return what the docstrings of a class and its bases say of a field; empty if they do not."""
    for base in section.__mro__:
        found = _described(base).get(name)
        if found:
            return found
    text = section.model_fields[name].meaning
    return f"{text[:1].upper()}{text[1:]}." if text else ""


@cache
def _described(section: type[Any]) -> Mapping[str, str]:
    """Return the texts of the part `Attributes` of a class's own docstring, by name."""
    parts = ATTRIBUTES.split(inspect.cleandoc(section.__dict__.get("__doc__") or ""))
    found: dict[str, str] = {}
    for names, text in _ENTRY.findall(parts[1]) if len(parts) > 1 else ():
        found |= {name.strip(): " ".join(text.split()) for name in names.split(",")}
    return found


MAX_EXACT: Final = 2**53
"""Maximum size of a whole number that float64 distinguishes from its neighbours."""


def _whole(value: Any) -> Any:
    exact = isinstance(value, float) and value.is_integer() and abs(value) <= MAX_EXACT
    return int(value) if exact else value


WholeNumber = Annotated[int, Reads(_whole)]
"""An integer, which may be written `3e2`: no text, no `true`, no 100.5."""

Flag = bool
"""`true` or `false`: no 1, no `yes`."""


def _printable(text: Any) -> Any:
    if isinstance(text, str) and not text.isprintable():
        raise ValueError(
            "holds a character that cannot be printed; allowed: one line of plain text"
        )
    return text


Line = Annotated[str, Reads(_printable)]
"""One line of printable text: no line break, null byte or lone surrogate."""


def _not_empty(text: Any) -> Any:
    if text == "":
        raise ValueError(f"is {quoted(text)}; must not be empty")
    return text


NotEmpty = Annotated[Line, Reads(_not_empty)]
"""A `Line` that is not empty."""

NONE = Reads(lambda value: None if value == "none" else value)
"""Metadata that reads the word `none` as None."""


def named(value: Any) -> Any:
    """Return `foo` as `{law: foo}`, and a mapping as it is.

    Raises
    ------
    ValueError
        If the value is something else.
    """
    if isinstance(value, str):
        return {"law": value}
    if not isinstance(value, dict | Declared):
        raise ValueError(f"is {quoted(value)}; must be the name of a law or a mapping with `law:`")
    return value
