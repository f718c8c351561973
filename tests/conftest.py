from pathlib import Path

import pytest

TESTS = Path(__file__).parent
RANKS = {"cluster", "crash", "farm", "mpi"}
"""Folders whose tests start ranks and watch the clock: one at a time."""


def pytest_addoption(parser):
    parser.addoption(
        "--many", type=int, metavar="N", help="Kills of each set-up of the crash harness."
    )


@pytest.hookimpl(tryfirst=True)  # pytest-xdist reads the groups in its own
def pytest_collection_modifyitems(items):
    """With `-n 2 --dist loadgroup` a file stays on one core, and so do all those with ranks."""
    for item in items:
        parts = item.path.relative_to(TESTS).parts
        group = "ranks" if parts[0] in RANKS else "/".join(parts)
        item.add_marker(pytest.mark.xdist_group(group))
