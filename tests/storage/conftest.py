import resource

import pytest
from storage_rows import make


@pytest.fixture
def path(tmp_path):
    return make(tmp_path / "grains.h5")


@pytest.fixture
def file_size_limit():
    """Make writes beyond so many bytes fail, as on a full disc, until the test ends."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
