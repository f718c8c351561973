"""Places of labels on the small axes of the set's figures."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agglom_mpi.report.style import few_ticks


@given(st.floats(1e-9, 1e9), st.floats(1.01, 1e12), st.booleans())
def test_few_ticks_lie_within_the_axis(first, ratio, logarithmic):
    last = first * ratio
    ticks = few_ticks(first, last, logarithmic)
    assert len(ticks) <= 5
    assert all(first * (1 - 1e-6) <= tick <= last * (1 + 1e-6) for tick in ticks)
    assert sorted(set(ticks.tolist())) == ticks.tolist()


@pytest.mark.parametrize(
    ("first", "last", "ticks"),
    [
        (0.155, 0.3, [0.16, 0.2, 0.24, 0.28]),
        (1e-3, 0.3, [1e-3, 1e-2, 1e-1]),
        (0.001, 0.05, [0.001, 0.003, 0.01, 0.03]),
    ],
)
def test_a_logarithmic_axis_has_round_ticks(first, last, ticks):
    assert few_ticks(first, last, logarithmic=True) == pytest.approx(ticks)
