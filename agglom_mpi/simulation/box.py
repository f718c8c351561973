"""The cube −D ≤ r ≤ D: what is near what, and where a particle that leaves comes back."""

import math
from typing import NamedTuple

import numpy as np

from agglom_mpi.compilation import Submodel, question


class Periodic(NamedTuple):
    """A true periodic box: contacts by minimum image."""


class Reentry(NamedTuple):
    """As published: who leaves re-enters on the opposite face, and faces hide contacts  [A, B]."""


@question
def separation(escape: Submodel, difference: float, half_width: float) -> float:
    """Component in m, signed, of the vector between two particles in the box."""


@question
def distance_along(escape: Submodel, difference: float, half_width: float) -> float:
    """Magnitude in m of `separation`, without a branch."""


@question
def inside(escape: Submodel, coordinate: float, half_width: float) -> float:
    """Coordinate in m at which a particle that may have left the box is put."""


@question
def nearest_image(escape: Submodel, difference: float, side: float, per_side: float) -> float:
    """`separation` in m of particles that may be outside the box, without a branch.

    `side` is the edge of the box in m, `per_side` its inverse.
    """


@question
def drawn_in(escape: Submodel, coordinate: float, half_width: float) -> float:
    """Coordinate in m of a particle whose leaving the box is an event of its own."""


@question
def is_periodic(escape: Submodel) -> bool:
    """Whether contacts reach across faces."""


@separation.answer(Periodic)
def _minimum_image(escape, difference, half_width):  # type: ignore[no-untyped-def]
    if difference > half_width:
        return difference - 2.0 * half_width
    if difference < -half_width:
        return difference + 2.0 * half_width
    return difference


@separation.answer(Reentry)
def _plain(escape, difference, half_width):  # type: ignore[no-untyped-def]
    return difference


@distance_along.answer(Periodic)
def _minimum_image_distance(escape, difference, half_width):  # type: ignore[no-untyped-def]
    plain = abs(difference)
    return min(plain, abs(2.0 * half_width - plain))


@distance_along.answer(Reentry)
def _plain_distance(escape, difference, half_width):  # type: ignore[no-untyped-def]
    return abs(difference)


@inside.answer(Periodic)
def _wrapped(escape, coordinate, half_width):  # type: ignore[no-untyped-def]
    if abs(coordinate) <= half_width:
        return coordinate
    side = 2.0 * half_width
    return coordinate - side * math.floor((coordinate + half_width) / side)


@inside.answer(Reentry)
def _opposite_face(escape, coordinate, half_width):  # type: ignore[no-untyped-def]
    if abs(coordinate) <= half_width:
        return coordinate
    return -half_width if coordinate > 0.0 else half_width


@nearest_image.answer(Periodic)
def _rounded_image(escape, difference, side, per_side):  # type: ignore[no-untyped-def]
    return difference - side * np.rint(difference * per_side)


@nearest_image.answer(Reentry)
def _no_image(escape, difference, side, per_side):  # type: ignore[no-untyped-def]
    return difference


@drawn_in.answer(Periodic)
def _wrapped_in(escape, coordinate, half_width):  # type: ignore[no-untyped-def]
    return inside(escape, coordinate, half_width)


@drawn_in.answer(Reentry)
def _clamped(escape, coordinate, half_width):  # type: ignore[no-untyped-def]
    return min(max(coordinate, -half_width), half_width)


@is_periodic.answer(Periodic)
def _has_images(escape):  # type: ignore[no-untyped-def]
    return True


@is_periodic.answer(Reentry)
def _has_no_images(escape):  # type: ignore[no-untyped-def]
    return False
