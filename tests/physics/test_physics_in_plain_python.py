"""Formulas in plain Python, here and at their extremes; the slow tier compiles each set of laws."""

import pytest
from plain_python import COMPILES, assert_hold_in_plain_python


@pytest.mark.compiled
@pytest.mark.skipif(not COMPILES, reason="it is the other run")
def test_formulas_hold_in_plain_python():
    assert_hold_in_plain_python(["physics/test_*.py", "extremes/test_extremes_[ci]*.py"], 300)
