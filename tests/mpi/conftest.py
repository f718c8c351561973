import pytest


@pytest.fixture
def small(shared_campaign):
    """Return a folder with a small campaign and the file of its plain, undisturbed run."""
    return shared_campaign("small")
