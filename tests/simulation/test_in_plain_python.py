"""The cases marked `plain`, whose kernels the quick tier does not compile, in plain Python."""

import pytest
from plain_python import assert_hold_in_plain_python


@pytest.mark.parametrize(
    ("files", "least"),
    [
        pytest.param(
            ["simulation/test_frames_[ap]*.py", "simulation/test_simulation_[mp]*.py"],
            20,
            marks=pytest.mark.slow,
        ),
        (["simulation/test_[bce]*.py", "simulation/test_s[ap]*.py"], 60),
        (
            [
                "simulation/test_simulation_[elnr]*.py",
                "simulation/test_simulation_s[iy]*.py",  # sizes, symmetry
                *("accuracy/test_accuracy_[cf]*.py", "config/test_*.py"),
                *("runtime/test_quantity_runs.py", "analysis/test_imposed_speeds.py"),
            ],
            60,
        ),
    ],
)
def test_cases_that_are_not_compiled_hold_in_plain_python(files, least):
    assert_hold_in_plain_python(files, least)
