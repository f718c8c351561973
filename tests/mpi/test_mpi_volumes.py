"""Samples of larger volumes are the same whoever simulates and whoever writes."""

import pytest
from campaign_runs import (
    TINY,
    assert_same,
    assert_sound,
    decisions,
    finish,
    need_mpirun,
    need_parallel_hdf5,
    write_campaign,
)
from mpi_injections import of_ranks
from volume_runs import volume_bytes

from agglom_mpi.storage.reader import read_campaign

FINAL = "{strings: 3, samples: 20, volumes: [1, 2, 4]}"


@pytest.mark.parametrize(
    ("database", "ranks"),
    [
        of_ranks("gathered", 2, guard="runtime/test_volume_runs.py"),
        pytest.param("parallel", 3, marks=pytest.mark.parallel_hdf5),
    ],
)
def test_ranks_share_the_samples_of_larger_volumes(tmp_path, database, ranks):
    need_mpirun()
    if database == "parallel":
        need_parallel_hdf5()
    files = {}
    for name, more in (("plain", {}), ("shared", {"ranks": ranks})):
        write_campaign(tmp_path / f"{name}.yaml", **TINY, final=FINAL)
        options = ["--database", database] if more else []
        finish(tmp_path, f"{name}.yaml", "-q", *options, **more)
        files[name] = tmp_path / f"{name}.h5"
        assert_sound(files[name])
    assert_same(files["shared"], decisions(files["plain"]))
    assert volume_bytes(files["shared"]) == volume_bytes(files["plain"])
    rows = read_campaign(files["shared"]).volume_rows(4)
    assert set(rows["rank"]) == set(range(ranks))
