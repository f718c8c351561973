"""What each class of a kind defines: methods, marked in its base class; right fields of one's own.

The package's own classes are known to be right; the tests of the package run them. What is wrong
with a class of one's own would show where a number is read, stored or compiled, far from its field.
"""

from collections.abc import Callable, Iterator
from types import NoneType
from typing import Any, Final, TypeVar, get_args, get_origin

from agglom_mpi.declaration.declared import MISSING, DeclaredField
from agglom_mpi.declaration.reading import SOURCE_SHA256
from agglom_mpi.declaration.units import is_si, quoted
from agglom_mpi.formatting import pluralise

F = TypeVar("F", bound=Callable[..., Any])

_MARKS: Final = ("is_needed", "__isabstractmethod__")


def needed(method: F) -> F:
    """Mark a method, or the function of a property, that a class which a file can name defines."""
    method.is_needed = True  # type: ignore[attr-defined]
    return method


def missing_methods(component: Any) -> Iterator[tuple[str, str]]:
    """Yield each marked method that a class lacks, and the name of the base class that needs it.

    A field of the same name stands for a method.
    """
    known = set(component.model_fields)
    for kind in component.__mro__:
        for name, found in vars(kind).items():
            if name not in known and is_needed(found):
                yield name, kind.__qualname__
        known.update(vars(kind))


def is_needed(attribute: Any) -> bool:
    """Return whether a method or property of a class is marked by `needed`, or is abstract."""
    function = attribute.fget if isinstance(attribute, property) else attribute
    return any(getattr(function, mark, False) is True for mark in _MARKS)


def check_names(component: type[Any], base: type[Any]) -> None:
    """Raise a TypeError if a field hides an attribute that the package uses.

    Parameters
    ----------
    component
        The class.
    base
        The class of the package that it is derived from.
    """
    for name in component.model_fields:
        if name == component.named_by or name in base.model_fields:
            continue
        if name == SOURCE_SHA256 or (hasattr(base, name) and not is_needed(getattr(base, name))):
            user = base.__name__ if hasattr(base, name) else "a campaign's identity"
            raise TypeError(f"field {name} has a name that {user} uses; it needs another")


def check_number(
    name: str, field: DeclaredField, number: Any, kind: type[float] | type[int]
) -> None:
    """Raise a TypeError or ValueError if a field of numbers has no such type or default.

    Parameters
    ----------
    name, field
    number
        Its unit and limits, `In` or `Whole`.
    kind
        Type of each of its numbers, float or int.
    """
    if not is_si(number.unit):
        must = "must be a unit of the SI without factor, such as 'm/s' or 'J/m^2'"
        raise ValueError(f"field {name} is in '{number.unit}'; {must}")
    parts = list(_parts(field.annotation))
    if kind not in parts or not {kind, NoneType}.issuperset(parts):
        allowed = f"{kind.__name__}, or a tuple of a fixed number of these"
        found = field.annotation
        text = found.__name__ if isinstance(found, type) else str(found)
        raise TypeError(f"field {name} is {text}; must be {allowed}")
    if field.default is MISSING or (field.default is None and NoneType in parts):
        return
    several = get_origin(field.annotation) is tuple
    values: Any = field.default if several else (field.default,)
    count = len(parts) if several else 1
    is_tuple = isinstance(values, tuple) and len(values) == count
    if not is_tuple or any(
        isinstance(each, bool) or not isinstance(each, int | kind) for each in values
    ):
        wanted = "number" if kind is float else "whole number"
        message = f"has the default {quoted(field.default)}; must be {pluralise(count, wanted)}"
        raise TypeError(f"field {name} {message}")
    for value in values:
        if broken := number.limits.broken_by(value):
            raise ValueError(f"field {name} has the default {quoted(value)}; must be {broken}")


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield the types of a tuple or union, or the type itself; of others what they are."""
    inner = get_args(annotation)
    if not inner or get_origin(annotation) in (list, dict, set):
        yield annotation
        return
    for each in inner:
        yield from _parts(each)
