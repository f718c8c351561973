"""A small finished campaign, and copies of its file that something happened to."""

import shutil

import matplotlib as mpl
import pytest
from farm_runs import finish, write_campaign

mpl.use("agg")


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """Return the file of a finished campaign, quickstart.h5, six of its strings estimated again."""
    folder = tmp_path_factory.mktemp("finished")
    numbers = {"generations": 3, "max_samples": 30}
    write_campaign(folder / "quickstart.yaml", final="{strings: 6, samples: 12}", **numbers)
    finish(folder, "quickstart.yaml", ranks=None)
    return folder / "quickstart.h5"


@pytest.fixture
def copy(finished, tmp_path):
    """Return a copy of it that may be changed."""
    return shutil.copy(finished, tmp_path / "copy.h5")
