"""The cube −D ≤ r ≤ D: periodic images, re-entry, shear, and sorting particles into cells."""

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np

from agglom_mpi.compilation.stages import formula, inlined, inlined_allocating
from agglom_mpi.declaration.components import In
from agglom_mpi.declaration.laws import Law, Reported, Values
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

    def wrapped_height(self, coordinate: float, half_width: float) -> float:
        """Return `wrapped` of the coordinate y in m."""
        return wrapped(self, coordinate, half_width)

    def is_sheared(self) -> bool:
        """Whether images of the box beyond the faces of y move along x; see `Shear`."""
        return False

    def flow_speed(self, height: float) -> float:
        """Mean velocity along x in m/s at the coordinate y = `height` in m."""
        return 0.0

    def image_offset(self, side: float, time: float) -> float:
        """Way in m, from 0 to `side`, that the image above is ahead along x at `time` in s."""
        return 0.0

    def shift_time(self, shifts: int, per_axis: int) -> float:
        """Time in s at which the image above is ahead by `shifts` cells of the box's `per_axis`."""
        return math.inf


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


class Shear(Periodic):
    """Periodic box in uniform shear: grains flow along x, the faster the higher in y.

    The images of the box above and below move along x by `rate` times the edge, so that the mean
    flow u_x = `rate` y has no faces (A. W. Lees and S. F. Edwards, J. Phys. C 5 (1972) 1921). Who
    crosses a face of y goes on as its image: shifted along x, and slower or faster by the flow.

    Attributes
    ----------
    rate
        Velocity of the mean flow over the height, du_x/dy.
    """

    law: Literal["shear"] = "shear"  # type: ignore[assignment]  # a periodic box but for y
    example: ClassVar[str] = "{law: shear, rate: 100 1/s}"
    rate: Annotated[float, In("1/s", above=0)]
    summary: ClassVar[str] = "periodic box in uniform shear, u_x = rate y [Lees and Edwards 1972]"

    def entries(self) -> Any:
        """Return the name and the rate."""
        return Law.entries(self)

    def wrapped_height(self, coordinate, half_width):
        """Return it as it is: across a face of y the velocity changes, too."""
        return coordinate

    def is_sheared(self):
        """Return True."""
        return True

    def flow_speed(self, height):
        """Rate times height."""
        return self.rate * height

    def image_offset(self, side, time):
        """Rate times edge times time, less whole edges."""
        strain = self.rate * time
        return side * (strain - math.floor(strain))

    def shift_time(self, shifts, per_axis):
        """Return when the strain is that many cells of an edge."""
        return shifts / (self.rate * per_axis)

    def reported(self) -> Iterator[Reported]:
        """Yield the strain of a sample, and how fast shear is beside the motion of grains."""
        yield Reported("strain", "1", _strain, "rate times the end time")
        note = "rate²b²/⟨c²⟩, b the radius and c the starting velocities about the mean flow"
        yield Reported("reduced shear rate²", "1", _reduced_rate, note)


def _strain(law: Any, scene: Any, value: Values) -> float:
    """Return the rate times the end time."""
    from agglom_mpi.physics.scales import end_time

    return float(law.rate * end_time(scene, value))


def _reduced_rate(law: Any, scene: Any, value: Values) -> float:
    """Return rate²b²/⟨c²⟩ of the start."""
    from agglom_mpi.physics.scales import grain_radius

    variance = scene.velocities.variance(value["relative_speed"])
    square = (law.rate * grain_radius(scene, value)) ** 2
    return float(square / variance) if variance > 0.0 else math.inf


separation = formula(Boundary, Boundary.separation)
distance_along = formula(Boundary, Boundary.distance_along)
wrapped = formula(Boundary, Boundary.wrapped)
nearest_image = formula(Boundary, Boundary.nearest_image)
clamped_position = formula(Boundary, Boundary.clamped_position)
is_periodic = formula(Boundary, Boundary.is_periodic)
wrapped_height = formula(Boundary, Boundary.wrapped_height)
is_sheared = formula(Boundary, Boundary.is_sheared)
flow_speed = formula(Boundary, Boundary.flow_speed)
image_offset = formula(Boundary, Boundary.image_offset)
shift_time = formula(Boundary, Boundary.shift_time)


@inlined
def wrapped_position(scene, position):
    """Place in m at which a particle that may have left the box is put, three components.

    Where the box is sheared, that is not through a face of y; see `shear.put_into_box`.
    """
    escape, half_width = scene.escape, scene.half_width
    return (
        wrapped(escape, position[0], half_width),
        wrapped_height(escape, position[1], half_width),
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
