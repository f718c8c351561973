"""Keys that stand in place of one another; a section has exactly one of them."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Annotated, Any, Final, NamedTuple

from pydantic import BeforeValidator, Field

from agglom_mpi.declaration.declared import LATER
from agglom_mpi.declaration.units import to_si

SIZES: Final = ("half_width", "grain_diameter", "grain_radius")
"""Keys of a scene for its size; one of them is given."""


FRACTIONS: Final = ("size_ratio", "volume_fraction")
"""Keys of the variables for the filling of the box; one of them is given."""


class _Beside(NamedTuple):
    """Stands for the value of a key that is given beside another in whose place it stands."""

    other: str
    """How it is called in a message."""


class _Absent:
    """Stands for the value of a key in whose place another one is given."""


def one_of(keys: tuple[str, ...], data: Any) -> Any:
    """Return a section's data in which a second one of these keys, or the lack of one, is marked.

    `read_marked` then reports it among the other mistakes of the section.
    """
    if not isinstance(data, Mapping):
        return data
    given = [key for key in keys if key in data]
    marks: dict[str, Any] = {key: _Beside(given[0]) for key in given[1:]}
    if given and keys[0] not in given:
        marks[keys[0]] = _Absent()
    return {**data, **marks}


def none_of(keys: tuple[str, ...], data: Any, other: str) -> Any:
    """Return a section's data in which each of these keys is marked, for `other` stands there."""
    given = [key for key in keys if key in data]
    marks: dict[str, Any] = {key: _Beside(other) for key in given}
    return {keys[0]: _Absent(), **data, **marks}


def read_marked(value: Any, keys: tuple[str, ...], read: Callable[[Any], Any]) -> Any:
    """Return what `read` makes of a value that `one_of` may have marked; None for a lack."""
    match value:
        case _Absent():
            return None
        case _Beside():
            raise ValueError(f"is given beside {value.other}; give one of {', '.join(keys)}")
    return read(value)


def _read_length(value: Any) -> Any:
    return read_marked(value, SIZES, partial(to_si, unit="m"))


_Positive = Annotated[float, Field(gt=0)] | None

HalfWidth = Annotated[
    _Positive,
    BeforeValidator(_read_length),
    Field(description="half the edge, like '1 cm', or grain_diameter, like '50 um', or sizes in m"),
]
"""Metres; None where the size of the grains is given."""
GrainSize = Annotated[_Positive, BeforeValidator(_read_length), LATER]
"""Metres; None where the half-width is given."""
