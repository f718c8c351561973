"""Initial state: random sequential placement without overlap, and starting velocities.

Placement one after another jams from a volume fraction of a third on, near 0.38 nearly always. A
sphere that finds no place then lets the others move about: the equilibrium fluid leaves gaps for
one more up to far denser packings.
"""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.compilation.stages import (
    Submodel,
    dispatch,
    inlined,
    inlined_allocating,
    not_inlined,
)
from agglom_mpi.physics.velocities import draw_velocities
from agglom_mpi.simulation.boundary import (
    cell_of,
    distance_along,
    flow_speed,
    is_periodic,
    is_sheared,
    wrapped,
    wrapped_cell,
)
from agglom_mpi.simulation.scene import is_aborted

ATTEMPTS: Final = 100_000
"""Trials per sphere before the others move; at φ = 0.268 about 70 are the rule."""

ATTEMPTS_BETWEEN: Final = 1000
SHUFFLES: Final = 300
"""Trials after each time that all others moved, and how often they do before it counts as jammed.

At φ = 0.38 one trial in 3000 succeeds at equilibrium (Carnahan and Starling).
"""

STRIDE: Final = 0.2
"""Largest displacement along an axis of a sphere that makes room, over its diameter."""


class EqualSizes(NamedTuple):
    """All spheres have one `diameter` in m."""

    diameter: float


class DifferentSizes(NamedTuple):
    """Each sphere has its own `radius` in m, shape (N,); the `largest` in m is one of them."""

    radius: np.ndarray
    largest: float


@dispatch
def contact_distance(sizes: Submodel, i: int, j: int) -> float:
    """Centre distance in m at which spheres i and j touch."""


@dispatch
def largest_diameter(sizes: Submodel) -> float:
    """Diameter in m of the largest sphere."""


@contact_distance.register(EqualSizes)
def _one_diameter_apart(sizes, i, j):
    return sizes.diameter


@contact_distance.register(DifferentSizes)
def _sum_of_radii(sizes, i, j):
    return sizes.radius[i] + sizes.radius[j]


@largest_diameter.register(EqualSizes)
def _one_diameter(sizes):
    return sizes.diameter


@largest_diameter.register(DifferentSizes)
def _twice_the_largest(sizes):
    return 2.0 * sizes.largest


@inlined_allocating
def place_randomly(random, escape, position, sizes, half_width, abort):
    """Place spheres one after another at free random places.

    The largest should come first: that jams less. Cells hold the spheres placed so far, so a trial
    looks at its 27 cells only.

    Parameters
    ----------
    random : numpy.random.Generator
    escape : Periodic or Reentry
    position : array, shape (3, N), m, filled
    sizes : EqualSizes or DifferentSizes
    half_width : float, m
    abort : uint8 array, shape (1,); anything but 0 ends the search for places

    Returns
    -------
    bool
        False if a sphere found no place: the packing jammed, or the search was ended.
    """
    count = position.shape[1]
    diameter = largest_diameter(sizes)
    width = 2.0 * half_width
    most = int((4.0 * count) ** (1.0 / 3.0)) + 1
    cells = min(most, max(1, int(min(width / diameter, 1e6))))
    head = np.full((cells, cells, cells), -1, np.int64)
    following = np.full(count, -1, np.int64)
    cell = np.empty(3, np.int64)
    return place_all(random, escape, position, cell, head, following, sizes, half_width, abort)


@inlined
def place_all(random, escape, position, cell, head, following, sizes, half_width, abort):
    """Place the spheres into the cells; False if one found no place or the run is to end."""
    for i in range(position.shape[1]):
        free = False
        for shuffles in range(SHUFFLES + 1):
            if is_aborted(abort):
                return False
            if shuffles > 0:
                shuffle(random, escape, position, cell, head, following, i, sizes, half_width)
            trials = ATTEMPTS if shuffles == 0 else ATTEMPTS_BETWEEN
            for _ in range(trials):
                for axis in range(3):
                    position[axis, i] = 2.0 * half_width * random.random() - half_width
                set_cell(position, i, cell, head, half_width)
                if is_free(escape, position, i, cell, head, following, sizes, half_width):
                    free = True
                    break
            if free:
                break
        if not free:
            return False
        following[i] = head[cell[0], cell[1], cell[2]]
        head[cell[0], cell[1], cell[2]] = i
    return True


@inlined
def set_cell(position, i, cell, head, half_width):
    """Write the cell that sphere i is in into `cell`."""
    for axis in range(3):
        cell[axis] = cell_of(position[axis, i], head.shape[0], half_width)


@not_inlined
def shuffle(random, escape, position, cell, head, following, count, sizes, half_width):
    """Move each of the first `count` spheres a little, if its new place is free (Monte Carlo)."""
    before = (0.0, 0.0, 0.0)
    for i in range(count):
        set_cell(position, i, cell, head, half_width)
        remove_from_cell(cell, head, following, i)
        before = (position[0, i], position[1, i], position[2, i])
        boxed = True
        for axis in range(3):
            stride = STRIDE * contact_distance(sizes, i, i)
            moved = position[axis, i] + stride * (2.0 * random.random() - 1.0)
            boxed = boxed and (is_periodic(escape) or abs(moved) <= half_width)
            position[axis, i] = wrapped(escape, moved, half_width)
        set_cell(position, i, cell, head, half_width)
        free = is_free(escape, position, i, cell, head, following, sizes, half_width)
        if not (boxed and free):
            for axis in range(3):
                position[axis, i] = before[axis]
            set_cell(position, i, cell, head, half_width)
        following[i] = head[cell[0], cell[1], cell[2]]
        head[cell[0], cell[1], cell[2]] = i


@inlined
def remove_from_cell(cell, head, following, i):
    """Remove sphere i from the list of its cell."""
    j = head[cell[0], cell[1], cell[2]]
    if j == i:
        head[cell[0], cell[1], cell[2]] = following[i]
        return
    while following[j] != i:
        j = following[j]
    following[j] = following[i]


@inlined
def is_free(escape, position, i, cell, head, following, sizes, half_width):
    """Whether sphere i overlaps none of the placed ones in the cells around it.

    What is most likely in its way comes first: the spheres of its own cell, then those of the seven
    cells that it is nearest to.
    """
    cells = head.shape[0]
    if not is_free_of(
        escape, position, i, head[cell[0], cell[1], cell[2]], following, sizes, half_width
    ):
        return False
    if cells == 1:
        return True
    p = nearer_side(position[0, i], cell[0], cells, half_width)
    q = nearer_side(position[1, i], cell[1], cells, half_width)
    s = nearer_side(position[2, i], cell[2], cells, half_width)
    for farther in range(2):
        for dx in range(2 + farther):
            a = wrapped_cell(cell[0] + beside(dx, p), cells)
            for dy in range(2 + farther):
                b = wrapped_cell(cell[1] + beside(dy, q), cells)
                for dz in range(2 + farther):
                    if farther == 1 and max(dx, dy, dz) < 2:
                        continue
                    j = head[a, b, wrapped_cell(cell[2] + beside(dz, s), cells)]
                    if not is_free_of(escape, position, i, j, following, sizes, half_width):
                        return False
    return True


@inlined
def nearer_side(coordinate, index, cells, half_width):
    """1 where a coordinate in m is in the upper half of its cell along an axis, else −1."""
    return 1 if (coordinate + half_width) * cells > (2 * index + 1) * half_width else -1


@inlined
def beside(number, side):
    """Offset along an axis: 0, then the nearer `side`, then the other one."""
    return 0 if number == 0 else (side if number == 1 else -side)


@inlined
def is_free_of(escape, position, i, j, following, sizes, half_width):
    """Whether sphere i overlaps none in the list that starts with j."""
    while j >= 0:
        square = 0.0
        for axis in range(3):
            difference = position[axis, i] - position[axis, j]
            square += distance_along(escape, difference, half_width) ** 2
        reach = contact_distance(sizes, i, j)
        if square < reach * reach:
            return False
        j = following[j]
    return True


@kernel
def scatter(escape, velocities, random, sizes, half_width, position, velocity, abort):
    """Place spheres as the grains of a sample are placed, and draw their velocities.

    In shear these have the mean flow in them.

    Parameters
    ----------
    escape, velocities, half_width
        Those of the scene, without its laws: one machine code serves many scenes.
    random : numpy.random.Generator
    sizes : EqualSizes, DifferentSizes, or None if positions are given
    position, velocity : array, shape (3, N), m and m/s, filled; velocity None if given
    abort : uint8 array, shape (1,); anything but 0 ends the search for places

    Returns
    -------
    bool
        False if a sphere found no place, or the search was ended.
    """
    if sizes is not None:  # noqa: SIM102  (types decide this one when it is compiled)
        if not place_randomly(random, escape, position, sizes, half_width, abort):
            return False
    if velocity is not None:
        draw_velocities(velocities, random, velocity)
        if is_sheared(escape):
            for i in range(velocity.shape[1]):
                velocity[0, i] += flow_speed(escape, position[1, i])
    return True
