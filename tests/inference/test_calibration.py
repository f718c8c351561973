import re

import pytest
from set_runs import calibrated


@pytest.mark.parametrize(
    ("coverage", "passed", "too_wide"),
    [(0.79, False, False), (0.80, True, False), (0.97, True, False), (1.0, True, True)],
)
def test_only_too_narrow_intervals_are_refused(doubling, coverage, passed, too_wide):
    found = calibrated(doubling, coverage)
    assert (found.passed, found.too_wide) == (passed, too_wide)
    assert f"{100 * coverage:.3g}" in found.text
    numbers = re.findall(r"\d+(?:\.\d+)?", found.text)
    assert (f"{found.width:.2g}" in numbers) is too_wide
    assert 0.0 < found.width < 10.0
