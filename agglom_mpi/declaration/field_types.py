"""Types of fields beside numbers with units, and how an entry names a component."""

from typing import Annotated, Any, Final

from agglom_mpi.declaration.declared import Declared, Reads
from agglom_mpi.declaration.units import quoted

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
