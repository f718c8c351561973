"""Stand-ins for components of one's own: what a file knows of them without their code.

A campaign file records of each such class its fields with unit and limits, and the answers that it
gave to the rest of the package: its summary, its flags, the variables that it needs. A stand-in is
made of that record. It reads its numbers from the campaign's text, answers as the class did, and
refuses whatever would need a formula.
"""

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, get_args, get_origin

from agglom_mpi.declaration.components import Component, In, Whole, number_of
from agglom_mpi.declaration.declared import (
    LATER,
    MISSING,
    DeclaredField,
    Reads,
    plain,
)
from agglom_mpi.declaration.own_modules import OwnModule, own_module
from agglom_mpi.declaration.users_code import users_code
from agglom_mpi.errors import CodeNotAllowedError

if TYPE_CHECKING:
    from agglom_mpi.declaration.declared import Declared

Record = dict[str, Any]
"""Plain values for JSON."""

MAX_SEVERAL: Final = 1000
"""Maximum number of numbers of one recorded field: each takes memory for its checks."""

_PLAIN: Final = (bool, int, float, str, type(None))
_OF_DECLARATIONS: Final = {
    *("own", "model_fields", "Numbers", "needed", "breaks", "names", "as_mapping"),
    *("problems", "settings", "entries", "recorded", "record", "restored", "lacking"),
    "check_complete",
}
"""Attributes that belong to the declaration of a class; the rest of the package asks for none."""


# Recording


def record_of(component: Component) -> Record:
    """Return the record of a component of one's own, plain values for JSON."""
    kind = type(component)
    base = kind.base()
    own = own_module(kind.__module__) or kind.own
    assert own is not None
    answers: Record = {}
    methods: Record = {}
    refused: list[str] = []
    names = list(_given_names(kind, base))
    for name in names:
        value = _answer(component, name)
        if callable(value):
            value = _called(value)
            if value is not MISSING:
                methods[name] = value
                continue
        if value is MISSING or not _is_plain(value):
            refused.append(name)
        else:
            answers[name] = plain(value)
    return {
        "file": own.file,
        "sha256": own.sha256,
        **({"read": dict(own.values)} if own.values else {}),
        "base": f"{base.__module__}:{base.__qualname__}",
        "fields": {
            name: _field_record(field, getattr(component, name))
            for name, field in kind.model_fields.items()
            if name != kind.named_by and base.model_fields.get(name) != field
        },
        "values": _values(component, kind.model_fields),
        "answers": answers,
        "calculated": [name for name in names if name in answers and _is_calculated(kind, name)],
        "methods": methods,
        "refused": refused,
        **component.record(),
    }


def _given_names(kind: type[Component], base: type[Component]) -> Iterator[str]:
    """Yield the public names of a class, no fields, that it does not inherit from the package."""
    own = kind.__mro__[: kind.__mro__.index(base)]
    names = dict.fromkeys(name for each in own for name in vars(each))
    skipped = {*kind.model_fields, *_OF_DECLARATIONS}
    yield from (name for name in names if not name.startswith("_") and name not in skipped)


def _values(component: Component, fields: Iterable[str]) -> Record:
    """Return the values of those fields that are numbers."""
    kinds = type(component).model_fields
    numbers = [name for name in fields if name in kinds and number_of(kinds[name]) is not None]
    return {name: plain(getattr(component, name)) for name in numbers}


def _is_calculated(kind: type[Component], name: str) -> bool:
    """Return whether an attribute is a property, which may depend on the numbers."""
    return isinstance(inspect.getattr_static(kind, name, None), property | cached_property)


def _answer(component: Component, name: str) -> Any:
    """Return an attribute of a component, MISSING where it raises an exception."""
    try:
        with users_code(component.name):
            return getattr(component, name)
    except Exception:
        return MISSING


def _called(method: Callable[..., Any]) -> Any:
    """Return what a method without arguments returns, MISSING of all others."""
    try:
        if inspect.isclass(method) or inspect.signature(method).parameters:
            return MISSING
        with users_code(method.__name__):
            value = method()
    except Exception:
        return MISSING
    return plain(value) if _is_plain(value) else MISSING


def _is_plain(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    if isinstance(value, Mapping):
        return all(isinstance(k, str) and _is_plain(v) for k, v in value.items())
    return isinstance(value, _PLAIN)


def _field_record(field: DeclaredField, value: Any) -> Record:
    """Return the record of a field: its type, unit and limits, and its default if it has one."""
    found: Record = {}
    number, arguments = number_of(field), get_args(field.annotation)
    if number is not None:
        found = {"is": type(number).__name__, **number._asdict()}
        if get_origin(field.annotation) is tuple:
            found["several"] = len(arguments)
    elif get_origin(field.annotation) is Literal:
        found = {"is": "choice", "allowed": list(arguments)}
    else:
        found = {"is": "value", "value": plain(value)}
    if not field.is_required():
        found["default"] = plain(field.default)
    if LATER in field.metadata:
        found["later"] = True
    return found


# Standing in


def stand_in(kind: type[Component], name: str, record: Mapping[str, Any]) -> type[Component]:
    """Return the class that stands in for a class of one's own.

    Parameters
    ----------
    kind
        Base class of the components of its kind.
    name
        Its name, `FILE.py:Class`.
    record
        As from `record_of`.
    """
    for part in ("fields", "answers", "methods", "refused"):
        if not all(each.isidentifier() and each[0] != "_" for each in record[part]):
            raise ValueError("a name is none of a field or method")
    base = _base(kind, str(record["base"]))
    fields = {key: _field(field) for key, field in record["fields"].items()}
    namespace: dict[str, Any] = {
        "__module__": __name__,
        "__doc__": f"Stands in for {name}.",
        "__annotations__": {key: annotation for key, (annotation, _) in fields.items()},
        **{key: default for key, (_, default) in fields.items() if default is not MISSING},
        **{key: _Refused(name) for key in record["refused"]},
        **base.restored(record),
        **{key: _returning(value) for key, value in record["methods"].items()},
        **{key: _Refused(name) for key in base.refused_of_stand_ins},
    }
    calculated = {*record["calculated"], *record["methods"]}
    for key in list(namespace):
        if key in calculated or (key not in fields and _is_calculated(base, key)):
            namespace[key] = _Calculated(name, namespace[key], record["values"])
    metaclass: Any = type(base)
    made: type[Component] = metaclass(name.partition(":")[2], (base,), namespace)
    values = tuple(sorted(record.get("read", {}).items()))
    made.own = OwnModule(record["file"], record["sha256"], b"", values=values)
    made._call(name)
    return made


def _base(kind: type[Component], name: str) -> type[Component]:
    """Return the class of the package that a class of one's own was derived from."""
    module, _, qualified = name.partition(":")
    try:
        ours = module.startswith("agglom_mpi.")
        found = getattr(import_module(module), qualified) if ours else kind
    except (ImportError, AttributeError, ValueError):  # of another version
        return kind
    return found if isinstance(found, type) and issubclass(found, kind) else kind


def _field(record: Mapping[str, Any]) -> tuple[Any, Any]:
    """Return annotation and default of a field."""
    limits = {key: value for key, value in record.items() if key in In._fields + Whole._fields}
    annotation: Any
    match record["is"]:
        case "In":
            annotation = Annotated[float, In(**limits)]
            if "several" in record:
                if not 0 < record["several"] <= MAX_SEVERAL:
                    raise ValueError("a field has too many numbers")
                several: Any = tuple.__class_getitem__((float,) * record["several"])
                annotation = Annotated[several, In(**limits)]
        case "Whole":
            annotation = Annotated[int, Whole(**limits)]
        case "choice":
            annotation = Literal.__getitem__(tuple(record["allowed"]))
        case _:
            value = record["value"]
            annotation = Annotated[Any, Reads(lambda given: value)]
    if record.get("later"):
        annotation = Annotated[annotation, LATER]
    default = record.get("default", MISSING)
    return annotation, tuple(default) if isinstance(default, list) else default


def _returning(value: Any) -> Callable[..., Any]:
    return lambda self: value


class _Calculated:
    """Attribute of a stand-in that was recorded of certain numbers, and is refused with others."""

    def __init__(self, name: str, value: Any, values: Record) -> None:
        self._name = name
        self._value = value
        self._values = values

    def __get__(self, component: Component | None, kind: type[Any]) -> Any:
        if component is None:
            return self._value
        is_text = isinstance(self._value, str)
        if not is_text and _values(component, self._values) != self._values:
            raise CodeNotAllowedError(_not_allowed(self._name))
        bound = hasattr(self._value, "__get__")
        return self._value.__get__(component, kind) if bound else self._value


def _not_allowed(name: str) -> str:
    return f"{name} is code of one's own; --allow-code runs it"


class _Refused:
    """A formula, method or property of a stand-in: a CodeNotAllowedError when it is asked for."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, component: "Declared | None", kind: type[Any]) -> Any:
        if component is None:  # of the class, as by a registry
            return self
        raise CodeNotAllowedError(_not_allowed(self._name))
