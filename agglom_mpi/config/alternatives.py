"""Keys that stand in place of one another; a section has exactly one of them."""

from collections.abc import Mapping
from typing import Any, Final

from agglom_mpi.declaration.declared import FieldPath

SIZES: Final = ("half_width", "grain_diameter", "grain_radius")
"""Keys of a scene for its size; one of them is given."""


FRACTIONS: Final = ("size_ratio", "volume_fraction")
"""Keys of the variables for the filling of the box; one of them is given."""


def one_of(
    keys: tuple[str, ...], values: Mapping[Any, Any], other: str = ""
) -> tuple[dict[Any, Any], list[tuple[FieldPath, str]]]:
    """Return values with one of these keys at most, and problems of the others.

    None of them is kept where `other` stands in their place.
    """
    given = [key for key in keys if key in values]
    surplus = given if other else given[1:]
    beside = other or "".join(given[:1])
    message = f"is given beside {beside}; give one of {', '.join(keys)}"
    kept = {key: value for key, value in values.items() if key not in surplus}
    return kept, [((key,), message) for key in surplus]
