"""A small finished campaign, and copies of its file that something happened to."""

import shutil

import matplotlib as mpl
import pytest

mpl.use("agg")


@pytest.fixture(scope="session")
def finished(shared_campaign):
    """Return the file of a finished campaign, six of its strings estimated again."""
    return shared_campaign("estimated") / "estimated.h5"


@pytest.fixture
def copy(finished, tmp_path):
    """Return a copy of it that may be changed."""
    return shutil.copy(finished, tmp_path / "copy.h5")
