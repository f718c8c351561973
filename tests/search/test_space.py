import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from search_fakes import papers_box, unit_box

from agglom_mpi.random_streams import search_stream
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.variables import TEN


def mixed_box():
    lower, upper = np.zeros(TEN.count), np.ones(TEN.count)
    lower[3] = upper[3] = 0.7
    lower[9] = upper[9] = np.nan
    return SearchSpace(lower, upper)


def test_fixed_and_unused_components_are_not_searched():
    assert np.flatnonzero(~mixed_box().searched).tolist() == [3, 9]


def test_a_sample_lies_in_the_box_with_fixed_components_exact_and_unused_nan():
    space = mixed_box()
    for number in range(100):
        string = space.sample(search_stream(1, number))
        assert string.shape == (TEN.count,)
        assert string[3] == 0.7
        assert np.isnan(string[9])
        rest = string[space.searched]
        assert np.all((rest >= 0) & (rest <= 1))


def test_fixing_one_component_leaves_the_draws_of_the_others():
    free, mixed = unit_box().sample(search_stream(5)), mixed_box().sample(search_stream(5))
    searched = mixed_box().searched
    assert np.array_equal(free[searched], mixed[searched])


def test_clip_moves_to_the_nearest_point_and_keeps_unused_nan():
    strings = np.array([np.full(TEN.count, -1.0), np.full(TEN.count, 0.5), np.full(TEN.count, 3.0)])
    clipped = mixed_box().clip(strings)
    assert clipped[:, 0].tolist() == [0.0, 0.5, 1.0]
    assert clipped[:, 3].tolist() == [0.7, 0.7, 0.7]
    assert np.isnan(clipped[:, 9]).all()


@pytest.mark.parametrize(
    ("lower", "upper"),
    [
        (np.zeros(9), np.ones(10)),
        (np.ones(TEN.count), np.zeros(TEN.count)),
        (np.zeros(TEN.count), np.full(TEN.count, np.nan)),
        (np.zeros(TEN.count), np.full(TEN.count, np.inf)),
    ],
)
def test_bounds_that_are_no_box_are_refused(lower, upper):
    with pytest.raises(ValueError, match="bounds"):
        SearchSpace(lower, upper)


def test_bounds_cannot_be_changed_afterwards():
    with pytest.raises(ValueError, match="read-only"):
        unit_box().lower[0] = -1.0


def test_a_box_restricted_in_the_middle_is_centred_with_scaled_widths():
    box = unit_box().around(np.full(TEN.count, 0.5), 0.25)
    assert np.array_equal(box.lower, np.full(TEN.count, 0.375))
    assert np.array_equal(box.upper, np.full(TEN.count, 0.625))


def test_restrictions_accumulate():
    centre = np.full(TEN.count, 0.5)
    twice = unit_box().around(centre, 0.5).around(centre, 0.5)
    assert np.array_equal(twice.upper - twice.lower, np.full(TEN.count, 0.25))


def test_a_restricted_box_may_move_but_never_leaves_the_outermost_one():
    first = unit_box().around(np.full(TEN.count, 0.25), 0.5)
    second = first.around(np.full(TEN.count, 0.5), 0.5)
    assert np.array_equal(second.upper, np.full(TEN.count, 0.625))
    third = first.around(np.full(TEN.count, 0.125), 1.0)
    assert np.array_equal(third.lower, np.zeros(TEN.count))
    assert np.array_equal(third.upper, np.full(TEN.count, 0.375))


def test_restricting_keeps_fixed_and_unused_components():
    box = mixed_box().around(np.full(TEN.count, 0.2), 0.5)
    assert box.lower[3] == box.upper[3] == 0.7
    assert np.isnan(box.lower[9])
    assert np.isnan(box.upper[9])


@given(st.integers(0, 2**32), st.lists(st.floats(0.01, 1.0), min_size=1, max_size=8))
@settings(derandomize=True, deadline=None)
def test_any_chain_of_restrictions_stays_around_its_centre_inside_the_outermost_box(seed, factors):
    outermost = box = papers_box()
    for number, factor in enumerate(factors):
        centre = box.sample(search_stream(seed, number))
        box = box.around(centre, factor)
        used = box.searched
        assert np.all(box.lower[used] >= outermost.lower[used])
        assert np.all(box.upper[used] <= outermost.upper[used])
        assert np.array_equal(box.clip(centre), centre, equal_nan=True)
