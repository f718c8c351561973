"""The cases marked `plain`, whose kernels the quick tier does not compile, in plain Python."""

import os
import re
import sys
from pathlib import Path

import pytest
from processes import output_of, program

TESTS = Path(__file__).parents[1]
QUICK = ["simulation/test_[bce]*.py", "physics/test_*.py", "accuracy/test_accuracy_[cfi]*.py"]
"""In one process, whose start takes as long as most of these files."""


@pytest.mark.parametrize(
    ("files", "least"),
    [
        pytest.param(["simulation/test_frames_*.py"], 30, marks=pytest.mark.slow),
        pytest.param(["simulation/test_simulation_*.py"], 50, marks=pytest.mark.slow),
        (QUICK, 400),
        pytest.param(["extremes/test_*.py"], 15, marks=pytest.mark.slow),
    ],
)
def test_cases_that_are_not_compiled_hold_in_plain_python(files, least):
    words = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-m", "plain and not slow"]
    # As a part of this run it leaves it to the whole to look for what is left behind.
    variables = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTEST_XDIST_WORKER": "plain"}
    paths = sorted(path for pattern in files for path in TESTS.glob(pattern))
    with program([*words, *paths], cwd=TESTS.parent, env=variables) as process:
        said, _ = output_of(process)
    assert process.returncode == 0, said
    assert int(re.search(r"(\d+) passed", said)[1]) >= least
