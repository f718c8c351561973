import pytest


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory):
    """Return a folder with a campaign of some seconds and the file of its undisturbed run."""
    from farm_runs import SLOW, finish, write_campaign

    folder = tmp_path_factory.mktemp("undisturbed")
    write_campaign(folder / "slow.yaml", **SLOW)
    finish(folder, "slow.yaml")
    return folder


@pytest.fixture(scope="session")
def wanted(undisturbed):
    """Return what every run of that campaign must decide."""
    from farm_runs import decisions

    return decisions(undisturbed / "slow.h5")


@pytest.fixture
def folder(undisturbed, tmp_path):
    """Return a folder with that campaign alone."""
    (tmp_path / "slow.yaml").write_bytes((undisturbed / "slow.yaml").read_bytes())
    return tmp_path
