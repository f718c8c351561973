"""Censuses of samples on several ranks: sent, stored and judged as on one, killed or not."""

import pytest
from campaign_runs import (
    assert_same,
    assert_sound,
    decisions,
    finish,
    need_mpirun,
    need_parallel_hdf5,
)
from measured_runs import write_measured
from mpi_injections import of_ranks

from agglom_mpi.analysis.data_fit import describe_fit
from agglom_mpi.storage.reader import read_campaign


@pytest.mark.parametrize(
    "database",
    [
        of_ranks("gathered", guard="runtime/test_sizes_runs.py"),
        pytest.param("parallel", marks=pytest.mark.parallel_hdf5),
    ],
)
def test_ranks_decide_by_data_as_one_does(tmp_path, database):
    need_mpirun()
    if database == "parallel":
        need_parallel_hdf5()
    for name in ("one", "three"):
        (tmp_path / name).mkdir()
        write_measured(tmp_path / name)
    finish(tmp_path / "one", "measured.yaml")
    finish(tmp_path / "three", "measured.yaml", "--database", database, ranks=3)
    assert_same(tmp_path / "three" / "measured.h5", decisions(tmp_path / "one" / "measured.h5"))
    assert_sound(tmp_path / "three" / "measured.h5")


@pytest.mark.slow(guard="storage/test_storage_data.py")
def test_a_run_that_was_stopped_goes_on_without_its_file_of_sizes(tmp_path):
    write_measured(tmp_path, generations=("generations: 3", "generations: 2"))
    finish(tmp_path, "measured.yaml", "-o", "undisturbed.h5")
    finish(tmp_path, "measured.yaml", "--generations", "1")
    finish(tmp_path, "measured.yaml")
    path = tmp_path / "measured.h5"
    assert_same(path, decisions(tmp_path / "undisturbed.h5"))
    (tmp_path / "sieve.csv").unlink()
    assert_sound(path)
    data = read_campaign(path)
    lines = describe_fit(data, int(data.result_rows()["string"][0]))
    assert len(lines) == 1 + 3  # the data
