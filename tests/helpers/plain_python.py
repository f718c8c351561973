"""Cases whose kernels cost the quick tier too much: there they run in plain Python.

They are marked `plain`. Where kernels are compiled they count as slow; `test_in_plain_python.py`
runs them in a process in which nothing is compiled.
"""

import os

import pytest

PLAIN = pytest.mark.plain
FOLDERS = ("physics",)
"""Folders whose tests are all such cases: each combination of laws has a kernel of its own."""
COMPILES = os.environ.get("NUMBA_DISABLE_JIT", "0") == "0"


def mark_slow_if_compiled(items):
    """Leave cases marked `plain` to the slow tier where kernels are compiled."""
    for item in items:
        if item.path.parent.name in FOLDERS:
            item.add_marker("plain")
        if COMPILES and item.get_closest_marker("plain"):
            item.add_marker("slow")


def cases(values, quick, marks=PLAIN):
    """Return all values as parameters, with marks on those that are not quick."""
    return [value if value in quick else pytest.param(value, marks=marks) for value in values]
