"""Properties that hold for a few examples in the quick tests, and for many in the slow ones."""

import pytest
from hypothesis import given, settings

FEW = 25


def examples(many, *strategies, **named):
    """Make a test of a check of drawn values: of `FEW`, and of `many` if slow tests run."""

    def decorate(check):
        @pytest.mark.parametrize("count", [FEW, pytest.param(many, marks=pytest.mark.slow)])
        def test(count):
            chosen = settings(derandomize=True, deadline=None, max_examples=count)
            chosen(given(*strategies, **named)(check))()

        test.__name__, test.__doc__ = check.__name__, check.__doc__
        return test

    return decorate
