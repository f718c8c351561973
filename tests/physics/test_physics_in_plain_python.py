"""The tests of this folder, in plain Python; in the slow tier each set of laws is compiled."""

import pytest
from plain_python import COMPILES, assert_hold_in_plain_python


@pytest.mark.compiled
@pytest.mark.skipif(not COMPILES, reason="it is the other run")
def test_formulas_hold_in_plain_python():
    assert_hold_in_plain_python(["physics/test_*.py"], 300)
