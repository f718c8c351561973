"""Cells of a map: they cover the square once, and the edge between two values is refined."""

import pytest

from agglom_mpi.accuracy.maps.cells import Cell, edge_cells, first_cells, leaves

GRID = 4


def refined(is_sound, levels):
    """Return the values of all cells of a map refined at the edge of a set in the plane."""
    values, cells = {}, first_cells(GRID)
    for level in range(levels):
        values |= {cell: is_sound(*cell.centre(GRID)) for cell in cells}
        cells = [child for cell in edge_cells(values, GRID, level) for child in cell.children()]
    return values


def test_the_children_of_a_cell_cover_it():
    cell = Cell(1, 2, 5)
    centres = [child.centre(GRID) for child in cell.children()]
    assert sum(child.edge(GRID) ** 2 for child in cell.children()) == cell.edge(GRID) ** 2
    assert [sum(axis) / 4 for axis in zip(*centres, strict=True)] == list(cell.centre(GRID))


def test_the_leaves_cover_the_square_once():
    values = refined(lambda x, y: x * x + y * y < 0.5, 4)
    assert sum(cell.edge(GRID) ** 2 for cell in leaves(values)) == pytest.approx(1.0, rel=1e-14)


def test_a_plane_of_one_value_is_not_refined():
    assert set(refined(lambda x, y: True, 3)) == set(first_cells(GRID))


def test_the_edge_lies_within_the_finest_cells():
    """The area of a quarter disc, by the leaves inside, to the area of the cells at its edge."""
    levels = 5
    values = refined(lambda x, y: x * x + y * y < 0.5, levels)
    kept = leaves(values)
    inside = sum(cell.edge(GRID) ** 2 for cell in kept if values[cell])
    finest = [cell for cell in kept if cell.level == levels - 1]
    assert abs(inside - 3.141592653589793 / 8.0) < len(finest) * finest[0].edge(GRID) ** 2
    # A map as fine everywhere would need 4096 cells.
    assert len(values) < 1000


def test_only_cells_at_the_edge_are_refined_and_only_those_of_the_level():
    values = {cell: cell.column < 2 for cell in first_cells(GRID)}
    assert {cell.column for cell in edge_cells(values, GRID, 0)} == {1, 2}
    assert list(edge_cells(values, GRID, 1)) == []
