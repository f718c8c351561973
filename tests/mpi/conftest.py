import pytest


@pytest.fixture(scope="session")
def small(tmp_path_factory):
    """Return a folder with a small campaign and the file of its plain, undisturbed run."""
    from farm_runs import SMALL, finish, write_campaign

    folder = tmp_path_factory.mktemp("small")
    write_campaign(folder / "small.yaml", **SMALL)
    finish(folder, "small.yaml")
    return folder
