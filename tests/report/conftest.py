"""Copies of a finished campaign's file, and figures that need no screen."""

import shutil

import matplotlib as mpl
import pytest

from agglom_mpi.analysis.ranking import search_order
from agglom_mpi.storage.access import open_file
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.table import Table

mpl.use("agg")


@pytest.fixture
def copy(finished, tmp_path):
    """Return a copy of the finished campaign's file that may be changed."""
    return shutil.copy(finished, tmp_path / "copy.h5")


@pytest.fixture
def four_of_six(copy):
    """Return a copy without the fresh samples of the last two of six strings that had some."""
    data = read_campaign(copy)
    first, most, rows = data.fresh_from, data.max_samples, data.fresh_samples
    own = search_order(data, data.result_rows())
    estimated = [string for string in own if (rows["string"] == string).any()]
    with open_file(copy, write=True) as opened:
        table = Table(opened, "samples", copy)
        for string in estimated[4:]:
            count = int((rows["string"] == string).sum())
            table.mark_absent(string * most + first, count)
    return copy
