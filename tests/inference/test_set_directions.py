import numpy as np
import pytest

from agglom_mpi.inference.set_directions import nearest_group, rounded, set_variables, touched_ends
from agglom_mpi.physics.restitution import IMPACT_PRESSURE

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
    assert touched_ends(UNITS, density) == ends


def test_a_set_whose_box_was_narrowed_on_both_sides_touches_no_end(doubling):
    assert any(each.touches for each in doubling.variables)
    narrowed = doubling.points._replace(lower=np.full(3, 0.1), upper=np.full(3, 0.9))
    assert not any(each.touches for each in set_variables(doubling.emulated, narrowed))


def test_exponents_are_rounded_to_simple_fractions():
    assert [rounded(x) for x in (-0.498, 0.34, 1.02, 0.02)] == [-0.5, 1 / 3, 1.0, 0.0]


def test_a_direction_is_near_a_group_of_either_sign():
    along = np.array([[2.0, -1.0]])
    unit = along[0] / np.sqrt(5.0)
    assert nearest_group(-unit, along, [IMPACT_PRESSURE]) == (
        IMPACT_PRESSURE,
        pytest.approx(-1.0),
    )
    assert nearest_group(np.array([0.0, 1.0]), along, [IMPACT_PRESSURE])[0] is None
