"""Small campaigns and their sets; the campaigns are made once in a test run, by one worker."""

import pytest
from once import made_once, shared_folder


@pytest.fixture(scope="session")
def three(tmp_path_factory):
    """Return the file of a finished campaign of 240 samples in three variables."""
    from set_runs import three_variable_file

    from agglom_mpi import open_campaign

    folder = made_once(shared_folder(tmp_path_factory) / "three", three_variable_file)
    return open_campaign(folder / "three.h5")


@pytest.fixture(scope="session")
def measured_file(tmp_path_factory):
    """Return the path of the file of a finished small campaign with measured data."""
    from campaign_runs import finish
    from measured_runs import write_measured

    def make(folder):
        write_measured(folder)
        finish(folder, "measured.yaml")

    return made_once(shared_folder(tmp_path_factory) / "measured", make) / "measured.h5"


@pytest.fixture(scope="session")
def filled(tmp_path_factory):
    """Return the file of a campaign that searches the volume fraction, too slow to double them."""
    from set_runs import three_variable_file

    from agglom_mpi.storage.reader import read_campaign

    replaced = {"size_ratio: 0.633": "volume_fraction: [0.1, 0.3]", "[0.1, 30]": "[0.1, 1.2]"}
    folder = made_once(
        shared_folder(tmp_path_factory) / "filled",
        lambda folder: three_variable_file(folder, replaced),
    )
    return read_campaign(folder / "three.h5")


@pytest.fixture(scope="session")
def half(filled):
    """Return the set of strings of it that grow to 1.5 or more."""
    return _set_of(filled, "25%")


@pytest.fixture(scope="session")
def unreachable(filled):
    """Return the set of strings of it that double the grains, which is empty."""
    return _set_of(filled, 0.05)


@pytest.fixture(scope="session")
def doubling(three):
    """Return the set of strings of it that double the grains within 5 %."""
    return three.feasible_set(0.05)


def _set_of(data, tolerance):
    """Return the set of a file, calibrated or not."""
    from agglom_mpi.emulation.blas_threads import single_threaded
    from agglom_mpi.inference.feasible_set import FeasibleSet

    return single_threaded(FeasibleSet)(data, tolerance)
