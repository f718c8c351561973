import numpy as np
import pytest

from agglom_mpi.inference.set_directions import _touched

UNITS = (np.arange(10_000) + 0.5) / 10_000


@pytest.mark.parametrize(
    ("density", "ends"),
    [
        (np.ones_like(UNITS), ("lower", "upper")),
        (UNITS, ("upper",)),
        (1.0 - UNITS, ("lower",)),
        (np.exp(-((UNITS - 0.5) ** 2) / 0.02), ()),
        (np.where(UNITS > 0.99, 1.0, 0.0), ("upper",)),
    ],
)
def test_a_set_touches_an_end_where_it_is_about_as_dense_as_elsewhere(density, ends):
    assert _touched(UNITS, density, inside=False) == ends


def test_a_set_whose_box_was_narrowed_on_both_sides_touches_no_end():
    assert _touched(UNITS, np.ones_like(UNITS), inside=True) == ()
