import pytest
from set_runs import three_variable_file

from agglom_mpi import open_campaign


@pytest.fixture(scope="session")
def three(tmp_path_factory):
    """Return the file of a finished campaign of 240 samples in three variables."""
    return open_campaign(three_variable_file(tmp_path_factory.mktemp("three")))


@pytest.fixture(scope="session")
def doubling(three):
    """Return the set of strings of it that double the grains within 5 %."""
    return three.feasible_set(0.05)
