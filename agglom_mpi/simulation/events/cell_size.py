"""How large should cells be, and who is too large for them?"""

import math
from typing import Final

from agglom_mpi.compilation import rare_stage, stage
from agglom_mpi.simulation.events.cells import ALONG, MOST_GIANTS, most_cells

FEW: Final = 32
"""Particles up to which all pairs are as cheap as cells; measured, anything from 12 to 48 is."""

FEWEST_CELLS: Final = 4
"""Cells along an axis from which the nearest image is the only one in reach."""

ROOM_TO_GROW: Final = 2.0 ** (1.0 / 3.0)
"""Radius after two equals have merged, over that of one."""

WORTH: Final = 0.5
"""Cost of a look in cells, relative to comparing all, below which cells are worth it; a guess."""

BARELY: Final = 1.0 - 1e-12
"""Share of the cells that fit into the box, lest rounding make giants of who fits into a cell."""

CROSSING_COST: Final = 16.0
"""Time of one cell crossing over that of one pair of particles; 16 to 24 measured fastest."""


@stage
def best_edge(count, diameter, half_width):  # type: ignore[no-untyped-def]
    """Edge s in m of the cells that cost least, for many equal particles.

    A collision costs three searches of 27 cells, and as many crossings as cells fit into the mean
    free path λ = 1/(√2 π n d² χ), each with a search of nine. In pairs, with C = CROSSING_COST and
    n particles per volume, that is 81 n s³ + 3 λ/s (C + 9 n s³), least at the root of
    81 n s⁴ + 18 λ n s³ = λ C, which Newton's method approaches from above.
    """
    density = count / (8.0 * half_width**3)
    fraction = min(0.5, density * math.pi / 6.0 * diameter**3)
    contact_value = (1.0 - 0.5 * fraction) / (1.0 - fraction) ** 3
    path = 1.0 / (math.sqrt(2.0) * math.pi * density * diameter**2 * contact_value)
    edge = (CROSSING_COST / (18.0 * density)) ** (1.0 / 3.0)
    for _ in range(20):
        excess = (81.0 * edge + 18.0 * path) * density * edge**3 - path * CROSSING_COST
        edge -= excess / ((324.0 * edge + 54.0 * path) * density * edge**2)
    return edge


@stage
def cost_of_look(count, along, giants):  # type: ignore[no-untyped-def]
    """Pairs that one particle of `count` has to be compared with, on average."""
    if along == 0:
        return float(count)
    return 27.0 * (count - giants) / along**3 + giants


@stage
def rank_largest(particles, rank, count):  # type: ignore[no-untyped-def]
    """Sort the largest radii in m into `rank`, descending; the mean radius of `count` particles."""
    rank[:] = 0.0
    total, last = 0.0, rank.size - 1
    for i in range(particles.size[0]):
        radius = particles.radius[i]
        total += radius
        if radius > rank[last]:
            k = last
            while k > 0 and rank[k - 1] < radius:
                rank[k] = rank[k - 1]
                k -= 1
            rank[k] = radius
    return total / count


@rare_stage
def best_cells(scene, particles, cells, count):  # type: ignore[no-untyped-def]
    """Cells along an axis that make a look cheapest for the `count` particles as they are."""
    if count <= FEW:
        return 0, float(count)
    mean = rank_largest(particles, cells.rank, count)
    edge = best_edge(count, 2.0 * mean, scene.half_width)
    most = min(most_cells(count), cells.place.shape[1] // 3)
    chosen, cheapest = 0, float(count)
    for giants in range(MOST_GIANTS + 1):
        side = max(edge, 2.0 * cells.rank[giants])
        along = min(most, int(BARELY * 2.0 * scene.half_width / side))
        cost = cost_of_look(count, along, giants)
        if along >= FEWEST_CELLS and cost < min(cheapest, WORTH * count):
            chosen, cheapest = along, cost
    return chosen, cheapest


@stage
def choose_range(cells, largest, half_width):  # type: ignore[no-untyped-def]
    """Choose how far giants move before they look into the cells around them again.

    At most by a cell; and, with the `largest` radius in m, so little that the nearest image stays
    the only one in reach, where an eighth of D is enough for that.
    """
    if cells.shape[ALONG] > 0:
        spare = 0.5 * (half_width - 2.0 * ROOM_TO_GROW * largest)
        edge = 2.0 * half_width / cells.shape[ALONG]
        cells.range[0] = min(edge, max(0.125 * half_width, min(0.25 * half_width, spare)))
