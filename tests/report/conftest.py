"""Copies of a finished campaign's file, and figures that need no screen."""

import shutil

import matplotlib as mpl
import pytest

mpl.use("agg")


@pytest.fixture
def copy(finished, tmp_path):
    """Return a copy of the finished campaign's file that may be changed."""
    return shutil.copy(finished, tmp_path / "copy.h5")
