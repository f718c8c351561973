"""Fresh samples of the best strings are the same whoever simulates and whoever writes."""

import pytest
from campaign_runs import (
    assert_same,
    assert_sound,
    decisions,
    finish,
    need_mpirun,
    need_parallel_hdf5,
    write_campaign,
)
from reestimation_runs import assert_fresh_are_those_of_the_best, fresh_bytes, fresh_rows

SIZE = {"generations": 2, "max_samples": 12, "final": "{strings: 3, samples: 40}"}
PARALLEL = pytest.param("parallel", 3, marks=pytest.mark.parallel_hdf5)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Return the file of a plain run."""
    folder = tmp_path_factory.mktemp("plain")
    write_campaign(folder / "final.yaml", **SIZE)
    finish(folder, "final.yaml", "-q")
    return folder / "final.h5"


@pytest.mark.parametrize(
    ("database", "ranks"),
    [pytest.param("gathered", 2, marks=pytest.mark.slow), PARALLEL],
)
def test_ranks_share_the_fresh_samples(plain, tmp_path, database, ranks):
    need_mpirun()
    if database == "parallel":
        need_parallel_hdf5()
    write_campaign(tmp_path / "final.yaml", **SIZE)
    path, options = tmp_path / "final.h5", ["--database", database]
    finish(tmp_path, "final.yaml", *options, ranks=ranks)
    assert_same(path, decisions(plain))
    assert fresh_bytes(path) == fresh_bytes(plain)
    assert set(fresh_rows(path)["rank"]) == set(range(ranks))
    assert_fresh_are_those_of_the_best(path, tmp_path / "final.yaml", 3, 40)
    assert "finished already" in finish(tmp_path, "final.yaml", *options, ranks=ranks).stderr
    assert_sound(path)
