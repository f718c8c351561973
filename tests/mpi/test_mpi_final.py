"""Fresh samples of the best strings are the same whoever simulates and whoever writes."""

import os

import h5py
import pytest
from farm_runs import (
    SLOWLY,
    assert_same,
    assert_sound,
    decisions,
    finish,
    need_mpirun,
    write_campaign,
)
from final_runs import assert_fresh_are_those_of_the_best, fresh_bytes, fresh_rows

SIZE = {"generations": 2, "max_samples": 12, "final": "{strings: 3, samples: 40}"}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Return the file of a plain run."""
    folder = tmp_path_factory.mktemp("plain")
    write_campaign(folder / "final.yaml", **SIZE)
    finish(folder, "final.yaml", "-q")
    return folder / "final.h5"


@pytest.mark.parametrize(("database", "ranks"), [("gathered", 2), ("parallel", 3)])
def test_ranks_share_the_fresh_samples(plain, tmp_path, database, ranks):
    need_mpirun()
    if database == "parallel" and not h5py.get_config().mpi:
        assert "AGGLOM_NEEDS_PARALLEL_HDF5" not in os.environ
        pytest.skip("this build of h5py is serial; the other one runs these tests")
    write_campaign(tmp_path / "final.yaml", **SIZE)
    path, options = tmp_path / "final.h5", ["--database", database]
    finish(tmp_path, "final.yaml", *options, ranks=ranks, inject=SLOWLY)
    assert_same(path, decisions(plain))
    assert fresh_bytes(path) == fresh_bytes(plain)
    assert set(fresh_rows(path)["rank"]) == set(range(ranks))
    assert_fresh_are_those_of_the_best(path, tmp_path / "final.yaml", 3, 40)
    assert "finished already" in finish(tmp_path, "final.yaml", *options, ranks=ranks).stderr
    assert_sound(path)
