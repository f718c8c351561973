"""Sorting particles into the cells of a regular grid over the box."""

import numpy as np

from agglom_mpi.compilation import allocating, stage


@stage
def cell_of(coordinate, cells, half_width):  # type: ignore[no-untyped-def]
    """Index along one axis of the cell of a coordinate in m."""
    return min(cells - 1, max(0, int((coordinate + half_width) / (2.0 * half_width) * cells)))


@allocating
def sort_into_cells(particles, cells, half_width):  # type: ignore[no-untyped-def]
    """Particles in order of their cells, shape (N,), and where each cell starts in that order.

    Cell (a, b, c) of `cells`³ has the number (a·cells + b)·cells + c.
    """
    count = particles.size[0]
    number = np.empty(count, np.int64)
    start = np.zeros(cells**3 + 2, np.int64)
    for i in range(count):
        index = 0
        for axis in range(3):
            index = index * cells + cell_of(particles.position[axis, i], cells, half_width)
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


@stage
def wrapped_cell(index, cells):  # type: ignore[no-untyped-def]
    """Index of a cell along one axis, across the face if need be."""
    if index < 0:
        return index + cells
    return index - cells if index >= cells else index
