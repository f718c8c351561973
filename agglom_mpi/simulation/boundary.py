"""The cube −D ≤ r ≤ D: periodic images, re-entry, and the sorting of particles into cells."""

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from agglom_mpi.compilation.stages import Submodel, dispatch, inlined, inlined_allocating

Vector: TypeAlias = tuple[float, float, float]


class Periodic(NamedTuple):
    """A true periodic box: contacts by minimum image."""


class Reentry(NamedTuple):
    """As published: who leaves re-enters at the opposite face; no contacts across faces  [A, B].

    It is put on the face [A]; [B] prints r → −r, which can leave it outside after a long step.
    """


@dispatch
def separation(escape: Submodel, difference: float, half_width: float) -> float:
    """Signed component in m of the vector between two particles in the box; `difference` in m."""


@dispatch
def distance_along(escape: Submodel, difference: float, half_width: float) -> float:
    """Magnitude in m of `separation`, without a branch."""


@dispatch
def wrapped(escape: Submodel, coordinate: float, half_width: float) -> float:
    """Coordinate in m at which a particle that may have left the box is put."""


@dispatch
def nearest_image(escape: Submodel, difference: float, side: float, per_side: float) -> float:
    """`separation` in m of particles that may be outside the box, without a branch.

    `side` is the edge of the box in m, `per_side` its inverse.
    """


@dispatch
def clamped_position(escape: Submodel, scene: Any, position: Vector) -> Vector:
    """Place in m of a particle whose leaving the box is an event of its own, three components.

    With real faces it can be outside by rounding only, and must not re-enter before its event.
    """


@dispatch
def is_periodic(escape: Submodel) -> bool:
    """Whether contacts reach across faces."""


@separation.register(Periodic)
def _minimum_image(escape, difference, half_width):
    if difference > half_width:
        return difference - 2.0 * half_width
    if difference < -half_width:
        return difference + 2.0 * half_width
    return difference


@separation.register(Reentry)
def _plain(escape, difference, half_width):
    return difference


@distance_along.register(Periodic)
def _minimum_image_distance(escape, difference, half_width):
    plain = abs(difference)
    return min(plain, abs(2.0 * half_width - plain))


@distance_along.register(Reentry)
def _plain_distance(escape, difference, half_width):
    return abs(difference)


@wrapped.register(Periodic)
def _wrapped_periodically(escape, coordinate, half_width):
    if abs(coordinate) <= half_width:
        return coordinate
    side = 2.0 * half_width
    return coordinate - side * math.floor((coordinate + half_width) / side)


@wrapped.register(Reentry)
def _opposite_face(escape, coordinate, half_width):
    if abs(coordinate) <= half_width:
        return coordinate
    return -half_width if coordinate > 0.0 else half_width


@nearest_image.register(Periodic)
def _rounded_image(escape, difference, side, per_side):
    return difference - side * np.rint(difference * per_side)


@nearest_image.register(Reentry)
def _no_image(escape, difference, side, per_side):
    return difference


@clamped_position.register(Periodic)
def _wrapped_position(escape, scene, position):
    return wrapped_position(scene, position)


@clamped_position.register(Reentry)
def _between_faces(escape, scene, position):
    half_width = scene.half_width
    return (
        min(max(position[0], -half_width), half_width),
        min(max(position[1], -half_width), half_width),
        min(max(position[2], -half_width), half_width),
    )


@is_periodic.register(Periodic)
def _has_images(escape):
    return True


@is_periodic.register(Reentry)
def _has_no_images(escape):
    return False


@inlined
def wrapped_position(scene, position):
    """Place in m at which a particle that may have left the box is put, three components."""
    escape, half_width = scene.escape, scene.half_width
    return (
        wrapped(escape, position[0], half_width),
        wrapped(escape, position[1], half_width),
        wrapped(escape, position[2], half_width),
    )


@inlined
def cell_of(coordinate, cells, half_width):
    """Index along one axis of the cell of a coordinate in m."""
    return min(cells - 1, max(0, int((coordinate + half_width) / (2.0 * half_width) * cells)))


@inlined
def cells_of(particle, cells, half_width):
    """Return the indices along the axes of the cell of a particle."""
    return (
        cell_of(particle["x"], cells, half_width),
        cell_of(particle["y"], cells, half_width),
        cell_of(particle["z"], cells, half_width),
    )


@inlined_allocating
def sort_into_cells(particles, cells, half_width):
    """Particles in order of their cells, shape (N,), and where each cell starts in that order.

    Cell (a, b, c) of `cells`³ has the number (a·cells + b)·cells + c; a counting sort.
    """
    count = particles.size[0]
    number = np.empty(count, np.int64)
    start = np.zeros(cells**3 + 2, np.int64)
    for i in range(count):
        a, b, c = cells_of(particles.records[i], cells, half_width)
        index = (a * cells + b) * cells + c
        number[i] = index
        start[index + 2] += 1
    for index in range(cells**3):
        start[index + 2] += start[index + 1]
    order = np.empty(count, np.int32)
    for i in range(count):
        place = start[number[i] + 1]
        order[place] = i
        start[number[i] + 1] = place + 1
    return order, start


@inlined
def wrapped_cell(index, cells):
    """Index of a cell along one axis, wrapped across the faces of the box."""
    if index < 0:
        return index + cells
    return index - cells if index >= cells else index
