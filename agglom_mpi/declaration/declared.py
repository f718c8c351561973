"""Classes with declared fields. Pydantic checks their values, and is not loaded before.

A subclass of `Declared` annotates its fields, with limits and meaning as metadata. Its instances
are immutable. Given values are checked by a pydantic model of the fields, which is made when it
is first needed; `recorded` takes values that were checked before. So a command that only reads
recorded campaigns does not load pydantic.
"""

import copyreg
from abc import ABCMeta
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Final,
    NamedTuple,
    Self,
    TypeAlias,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from agglom_mpi.declaration.own_modules import reduced_class
from agglom_mpi.declaration.reading import Reading, reading_of

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, TypeAdapter
    from pydantic_core import CoreSchema

FieldPath: TypeAlias = tuple[str | int, ...]
"""Keys and list positions from the top of a file, or of a section, down to a field."""

LATER: Final = "added later"
"""Metadata of a field added after version 0.1.0: at its default it is not in the identity."""


class FieldError(ValueError):
    """Errors of fields, each with its path below the validated section."""

    def __init__(self, *problems: tuple[FieldPath, str]) -> None:
        super().__init__("; ".join(f"{'.'.join(map(str, path))}: {m}" for path, m in problems))
        self.problems = problems


def raise_field_errors(problems: Iterable[tuple[FieldPath, str]]) -> None:
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

    def __get_pydantic_core_schema__(
        self, source: Any, handler: "GetCoreSchemaHandler"
    ) -> "CoreSchema":
        """Return the schema of the field with the function before it."""
        from pydantic_core import core_schema

        if not self.in_context:
            return core_schema.no_info_before_validator_function(self.read, handler(source))
        return core_schema.with_info_before_validator_function(
            lambda value, info: self.read(value, reading_of(info)), handler(source)
        )


class Strict:
    """Metadata of a field whose value is not converted to its type."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: "GetCoreSchemaHandler"
    ) -> "CoreSchema":
        """Return the strict schema of the field."""
        schema: Any = handler(source)
        return {**schema, "strict": True}


class Meaning(NamedTuple):
    """Metadata of a field: what it is, as a message states it where the field is missing."""

    text: str


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
    def description(self) -> str | None:
        """Meaning of the field; None if its metadata do not state it."""
        return next((each.text for each in self.metadata if isinstance(each, Meaning)), None)


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
    def checked(cls, values: Mapping[Any, Any], reading: Reading | None = None) -> Self:
        """Return the instance of given values; raise a ValueError if they do not fit."""
        return cls._adapter().validate_python(dict(values), context=reading)

    @classmethod
    @cache
    def _adapter(cls) -> "TypeAdapter[Self]":
        from pydantic import TypeAdapter

        return TypeAdapter(cls)

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

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: Any, handler: "GetCoreSchemaHandler"
    ) -> "CoreSchema":
        """Return the schema with which pydantic makes an instance, or takes one as it is."""
        from pydantic_core import core_schema

        def read(value: Any, validate: Callable[[Any], Any]) -> Declared:
            if isinstance(value, cls):
                return value
            model = validate(value)
            made = cls._made({name: getattr(model, name) for name in cls.model_fields})
            made.__dict__["model_fields_set"] = frozenset(model.model_fields_set)
            raise_field_errors(made.problems())
            return made

        return core_schema.no_info_wrap_validator_function(
            read,
            handler.generate_schema(cls._model()),
            serialization=core_schema.plain_serializer_function_ser_schema(cls.model_dump),
        )

    @classmethod
    @cache
    def _model(cls) -> Any:
        """Return the pydantic model of the fields."""
        from pydantic import ConfigDict, create_model

        fields: dict[str, Any] = {}
        for name, field in cls.model_fields.items():
            hint: Any = field.annotation
            for each in field.metadata:
                hint = Annotated[hint, each]
            fields[name] = (hint, ... if field.is_required() else field.default)
        strict = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
        return create_model(cls.__name__, __config__=strict, __module__=cls.__module__, **fields)

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield fields that do not fit together: the path of each and what is wrong."""
        yield from ()

    def entries(self) -> Any:
        """Return all fields as plain values, without those marked `LATER` at their default."""
        return recorded_entries(self, self.model_fields)

    def model_dump(self) -> dict[str, Any]:
        """Return all fields, and those of their values, by name."""
        values = {name: getattr(self, name) for name in self.model_fields}
        return {k: v.model_dump() if isinstance(v, Declared) else v for k, v in values.items()}

    def model_copy(self, *, update: Mapping[str, Any] | None = None) -> Self:
        """Return a copy with some fields replaced, which are not checked."""
        copy = self.__new__(type(self))
        kept = {name for name in self.__dict__ if name in self.model_fields or name[0] == "_"}
        copy.__dict__.update({name: self.__dict__[name] for name in kept}, **(update or {}))
        copy.__dict__["model_fields_set"] = self.model_fields_set | frozenset(update or {})
        return copy

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
        fields = ", ".join(f"{name}={getattr(self, name)!r}" for name in self.model_fields)
        return f"{type(self).__name__}({fields})"


def _field(cls: type, name: str, hint: Any) -> DeclaredField:
    metadata, default = getattr(hint, "__metadata__", ()), getattr(cls, name, MISSING)
    return DeclaredField(hint.__origin__ if metadata else hint, metadata, default)


def declared_in(annotation: Any) -> Iterator[type[Declared]]:
    """Yield the classes of `Declared` that a type names."""
    if isinstance(annotation, type) and issubclass(annotation, Declared):
        yield annotation
    for inner in get_args(annotation):
        yield from declared_in(inner)


def recorded_entries(section: Any, fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a section as plain values, without those `LATER` at their default."""
    return {
        name: plain(getattr(section, name))
        for name, field in fields.items()
        if LATER not in field.metadata or getattr(section, name) != field.default
    }


def plain(value: Any) -> Any:
    """Return a value with all sections in it as plain values."""
    if hasattr(value, "entries"):
        return value.entries()
    if isinstance(value, dict):
        return {key: plain(inner) for key, inner in value.items()}
    return [plain(inner) for inner in value] if isinstance(value, list | tuple) else value
