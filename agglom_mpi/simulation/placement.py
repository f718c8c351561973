"""Where do the grains start?  Random sequential placement without overlap."""

from typing import Final

import numpy as np

from agglom_mpi.compilation import allocating, stage
from agglom_mpi.simulation.box import distance_along
from agglom_mpi.simulation.cells import wrapped_cell

ATTEMPTS: Final = 100_000
"""Trials per sphere before a placement counts as jammed; at φ = 0.268 about 70 are the rule."""


@allocating
def place(random, escape, position, diameter, half_width):  # type: ignore[no-untyped-def]
    """Place spheres of equal `diameter` in m one after another at free random places.

    Cells hold the spheres placed so far, so a trial looks at its 27 cells only.

    Parameters
    ----------
    random : numpy.random.Generator
    escape : Periodic or Reentry
    position : array, shape (3, N), m, filled
    diameter, half_width : float, m

    Returns
    -------
    bool
        False if a sphere found no place: the packing jammed.
    """
    count = position.shape[1]
    width = 2.0 * half_width
    most = int((4.0 * count) ** (1.0 / 3.0)) + 1
    cells = min(most, max(1, int(min(width / diameter, 1e6))))
    head = np.full((cells, cells, cells), -1, np.int64)
    following = np.full(count, -1, np.int64)
    cell = np.empty(3, np.int64)
    return fill(random, escape, position, cell, head, following, diameter, half_width)


@stage
def fill(random, escape, position, cell, head, following, diameter, half_width):  # type: ignore[no-untyped-def]
    """Place the spheres into the cells; False if one found no place."""
    cells = head.shape[0]
    width = 2.0 * half_width
    for i in range(position.shape[1]):
        for attempt in range(ATTEMPTS + 1):
            if attempt == ATTEMPTS:
                return False
            for axis in range(3):
                coordinate = width * random.random() - half_width
                position[axis, i] = coordinate
                cell[axis] = min(cells - 1, int((coordinate + half_width) / width * cells))
            if is_free(escape, position, i, cell, head, following, diameter, half_width):
                break
        following[i] = head[cell[0], cell[1], cell[2]]
        head[cell[0], cell[1], cell[2]] = i
    return True


@stage
def is_free(escape, position, i, cell, head, following, diameter, half_width):  # type: ignore[no-untyped-def]
    """Whether sphere i overlaps none of the placed ones in the cells around it."""
    cells = head.shape[0]
    if not is_free_of(
        escape, position, i, head[cell[0], cell[1], cell[2]], following, diameter, half_width
    ):
        return False
    around = min(1, cells - 1)
    for dx in range(-around, around + 1):
        a = wrapped_cell(cell[0] + dx, cells)
        for dy in range(-around, around + 1):
            b = wrapped_cell(cell[1] + dy, cells)
            for dz in range(-around, around + 1):
                j = head[a, b, wrapped_cell(cell[2] + dz, cells)]
                if not is_free_of(escape, position, i, j, following, diameter, half_width):
                    return False
    return True


@stage
def is_free_of(escape, position, i, j, following, diameter, half_width):  # type: ignore[no-untyped-def]
    """Whether sphere i overlaps none in the list that starts with j."""
    while j >= 0:
        square = 0.0
        for axis in range(3):
            difference = position[axis, i] - position[axis, j]
            square += distance_along(escape, difference, half_width) ** 2
        if square < diameter * diameter:
            return False
        j = following[j]
    return True
