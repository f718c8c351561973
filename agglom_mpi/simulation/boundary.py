"""The cube −D ≤ r ≤ D: periodic images, re-entry, and the sorting of particles into cells."""

import math
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np

from agglom_mpi.compilation.stages import formula, inlined, inlined_allocating
from agglom_mpi.declaration.laws import Law
from agglom_mpi.declaration.needed import needed

Vector: TypeAlias = tuple[float, float, float]


class Boundary(Law):
    """Law of the faces of the box; a file names it by `escape`."""

    found_in = ""
    may_be_own = False

    def entries(self) -> Any:
        """Return the name alone."""
        return self.name

    @needed
    def separation(self, difference: float, half_width: float) -> float:
        """Signed component in m of the vector between two particles in the box."""
        raise NotImplementedError

    @needed
    def distance_along(self, difference: float, half_width: float) -> float:
        """Magnitude in m of `separation`, without a branch."""
        raise NotImplementedError

    @needed
    def wrapped(self, coordinate: float, half_width: float) -> float:
        """Coordinate in m at which a particle that may have left the box is put."""
        raise NotImplementedError

    @needed
    def nearest_image(self, difference: float, side: float, per_side: float) -> float:
        """`separation` in m of particles that may be outside the box, without a branch.

        `side` is the edge of the box in m, `per_side` its inverse.
        """
        raise NotImplementedError

    @needed
    def clamped_position(self, scene: Any, position: Vector) -> Vector:
        """Place in m of a particle whose leaving the box is an event of its own, three components.

        With real faces it can be outside by rounding only, and must not re-enter before its event.
        """
        raise NotImplementedError

    @needed
    def is_periodic(self) -> bool:
        """Whether contacts reach across faces."""
        raise NotImplementedError


class Periodic(Boundary):
    """Periodic box, with contacts across its faces."""

    law: Literal["periodic"] = "periodic"
    summary: ClassVar[str] = "true periodic box, contacts across faces"

    def separation(self, difference, half_width):
        """Minimum image of the difference."""
        if difference > half_width:
            return difference - 2.0 * half_width
        if difference < -half_width:
            return difference + 2.0 * half_width
        return difference

    def distance_along(self, difference, half_width):
        """Smaller of the ways inside and across the face."""
        plain = abs(difference)
        return min(plain, abs(2.0 * half_width - plain))

    def wrapped(self, coordinate, half_width):
        """Coordinate shifted by whole edges into the box."""
        if abs(coordinate) <= half_width:
            return coordinate
        side = 2.0 * half_width
        return coordinate - side * math.floor((coordinate + half_width) / side)

    def nearest_image(self, difference, side, per_side):
        """Difference less whole edges."""
        return difference - side * np.rint(difference * per_side)

    def clamped_position(self, scene, position):
        """Place shifted by whole edges into the box."""
        return wrapped_position(scene, position)

    def is_periodic(self):
        """Return True."""
        return True


class Reentry(Boundary):
    """Grains re-enter at the opposite face; no contacts across faces, as published  [A, B].

    It is put on the face [A]; [B] prints r → −r, which can leave it outside after a long step.
    """

    law: Literal["reentry"] = "reentry"
    summary: ClassVar[str] = "re-entry at the opposite face, no contacts across faces, as published"

    def separation(self, difference, half_width):
        """Return the difference."""
        return difference

    def distance_along(self, difference, half_width):
        """Magnitude of the difference."""
        return abs(difference)

    def wrapped(self, coordinate, half_width):
        """Return the opposite face for a particle outside."""
        if abs(coordinate) <= half_width:
            return coordinate
        return -half_width if coordinate > 0.0 else half_width

    def nearest_image(self, difference, side, per_side):
        """Return the difference."""
        return difference

    def clamped_position(self, scene, position):
        """Place within the faces."""
        half_width = scene.half_width
        return (
            min(max(position[0], -half_width), half_width),
            min(max(position[1], -half_width), half_width),
            min(max(position[2], -half_width), half_width),
        )

    def is_periodic(self):
        """Return False."""
        return False

    def is_frame_dependent(self):
        """Return True: faces are real, and at rest in one frame alone."""
        return True


separation = formula(Boundary, Boundary.separation)
distance_along = formula(Boundary, Boundary.distance_along)
wrapped = formula(Boundary, Boundary.wrapped)
nearest_image = formula(Boundary, Boundary.nearest_image)
clamped_position = formula(Boundary, Boundary.clamped_position)
is_periodic = formula(Boundary, Boundary.is_periodic)


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
