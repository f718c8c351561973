import shutil

import pytest
from campaign_runs import decisions


@pytest.fixture(scope="session")
def undisturbed(shared_campaign):
    """Return a folder with a small campaign, small.yaml, and the file of its undisturbed run."""
    return shared_campaign("small")


@pytest.fixture(scope="session")
def wanted(undisturbed):
    """Return what every run of that campaign must decide."""
    return decisions(undisturbed / "small.h5")


@pytest.fixture
def folder(undisturbed, tmp_path):
    """Return a folder with that campaign alone."""
    shutil.copy(undisturbed / "small.yaml", tmp_path)
    return tmp_path
