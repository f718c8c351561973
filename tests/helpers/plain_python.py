"""Cases whose kernels cost the quick tier too much: there they run in plain Python.

They are marked `plain`. Where kernels are compiled they count as slow; `test_in_plain_python.py`
runs them in a process in which nothing is compiled.
"""

import os
import re
import sys
from pathlib import Path

import pytest
from processes import output_of, program

PLAIN = pytest.mark.plain
PLAIN_ALONE = pytest.mark.plain(compiled=False)
"""Compiled, such a case would show nothing that others do not; those that are slow are compiled."""
FOLDERS = ("physics",)
"""Folders whose tests are all such cases: each combination of laws has a kernel of its own."""
TESTS = Path(__file__).parents[1]
COMPILES = os.environ.get("NUMBA_DISABLE_JIT", "0") == "0"


def mark_slow_if_compiled(items):
    """Leave cases marked `plain` to the slow tier where kernels are compiled."""
    if COMPILES:
        items[:] = [
            item
            for item in items
            if item.get_closest_marker("slow") or PLAIN_ALONE.mark not in item.iter_markers("plain")
        ]
    for item in items:
        if item.path.parent.name in FOLDERS and not item.get_closest_marker("compiled"):
            item.add_marker("plain")
        if COMPILES and item.get_closest_marker("plain"):
            item.add_marker("slow")


def cases(values, quick, marks=PLAIN):
    """Return all values as parameters, with marks on those that are not quick."""
    return [value if value in quick else pytest.param(value, marks=marks) for value in values]


def assert_hold_in_plain_python(files, least):
    """Run the quick cases marked `plain` of files of tests; at least so many must pass."""
    words = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-m", "plain and not slow"]
    # As a part of this run it leaves it to the whole to look for what is left behind.
    variables = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTEST_XDIST_WORKER": "plain"}
    paths = sorted(path for pattern in files for path in TESTS.glob(pattern))
    with program([*words, *paths], cwd=TESTS.parent, env=variables) as process:
        said, _ = output_of(process)
    assert process.returncode == 0, said
    assert int(re.search(r"(\d+) passed", said)[1]) >= least
