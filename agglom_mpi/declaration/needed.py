"""Methods that each class of a kind defines, marked in the base class of the kind."""

from collections.abc import Callable, Iterator
from typing import Any, Final, TypeVar

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
