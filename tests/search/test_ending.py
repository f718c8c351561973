"""Criteria that end a campaign: what each decides, and how several compose."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from agglom_mpi.search.ending import (
    ExpectedError,
    Generations,
    MeanOfBest,
    any_of,
)


def search(mean=1.0, error=math.inf):
    """Return a search whose best strings have a mean objective, and its set an expected error."""
    return SimpleNamespace(mean_of_top=lambda top: mean, set_error=lambda: error)


LOW = MeanOfBest(top=6, objective=0.5)
KNOWN = ExpectedError(expected_error=0.1)
LAST = Generations(generations=4)


def test_each_criterion_holds_from_its_limit_on():
    assert LOW.holds(1, search(0.5))
    assert not LOW.holds(9, search(np.nextafter(0.5, 1.0)))
    assert KNOWN.holds(1, search(error=0.1))
    assert not KNOWN.holds(9, search())
    assert [LAST.holds(done, search()) for done in (3, 4, 5)] == [False, True, True]


def test_any_of_several_ends_by_the_first_that_holds():
    ending = any_of(LOW, KNOWN, LAST)
    assert ending.met(4, search(0.4, 0.01)) == LOW
    assert ending.met(4, search(0.6, 0.01)) == KNOWN
    assert ending.met(4, search(0.6)) == LAST
    assert ending.met(3, search(0.6)) is None
    assert ending.holds(4, search())
    assert (ending.best_strings, ending.max_generations) == (6, 4)


def test_one_criterion_is_composed_of_nothing():
    assert any_of(LAST) == LAST


@pytest.mark.parametrize("mean", [0.49, 0.51])
def test_the_row_of_a_generation_shows_its_mean_and_no_error_of_a_set(mean):
    row = np.array((mean,), [("mean_of_top", "f8")])[()]
    assert LOW.is_seen_in(row) == (mean < 0.5)
    assert not KNOWN.is_seen_in(row)
