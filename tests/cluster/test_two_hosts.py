"""Campaigns on two hosts, by each launcher: where a rank is changes nothing, nor does its end."""

import time

import pytest
from campaign_runs import (
    SMALL,
    TINY,
    assert_same,
    assert_sound,
    decisions,
    finish,
    inject,
    write_campaign,
)
from processes import output_of
from two_host_runs import LAUNCHERS, OPEN_MPI
from two_hosts import NAMES, clock_ahead

from agglom_mpi.storage.reader import read_campaign

pytestmark = pytest.mark.parallel_hdf5 if OPEN_MPI else pytest.mark.slow
COUNTS_COMPILATIONS = """
import os
from pathlib import Path

from agglom_mpi.compilation.kernel_cache import KernelCache

save = KernelCache.save_overload

def counted(self, sig, data):
    with open(Path(os.environ["TMPDIR"], "compiled"), "a") as file:
        file.write(f"{self._impl.filename_base} {sig}\\n")
    save(self, sig, data)

KernelCache.save_overload = counted
"""


def compiled_on(host):
    """Return the kernels that were compiled on a host, as often as they were."""
    path = host.local / "tmp" / "compiled"
    return path.read_text().splitlines() if path.exists() else []


@pytest.mark.parametrize("launch", LAUNCHERS[:1], indirect=True)
def test_kernels_compile_once_on_a_host_whose_home_is_read_only(launch, tmp_path, shared_campaign):
    """The first host has kernels, mostly: all tests that run in this process share them."""
    second = launch.hosts.second
    second.forget_kernels()
    second.close_home()
    folder = inject(tmp_path / "counting", COUNTS_COMPILATIONS)
    for host in launch.hosts:
        host.set_variables(inject=folder)
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    launch.finish("tiny.yaml", each=2)
    for host in launch.hosts:
        kernels = compiled_on(host)
        assert len(kernels) == len(set(kernels))
    assert compiled_on(second)
    assert list((second.local / "tmp").rglob("*.nbi"))
    assert not list((second.local / "home").iterdir())
    assert_same(tmp_path / "tiny.h5", decisions(shared_campaign("tiny") / "tiny.h5"))


def test_ranks_on_two_hosts_store_the_rows_of_a_plain_run(launch, tmp_path, undisturbed):
    write_campaign(tmp_path / "small.yaml", **SMALL)
    launch.finish("small.yaml", each=2)
    legs = read_campaign(tmp_path / "small.h5").legs()
    assert (legs["ranks"].tolist(), legs["nodes"].tolist()) == ([4], [2])
    assert_same(tmp_path / "small.h5", undisturbed)
    assert_sound(tmp_path / "small.h5")


@pytest.mark.parametrize("ahead", NAMES)
@pytest.mark.parametrize("launch", LAUNCHERS[:1], indirect=True)
def test_a_clock_that_is_an_hour_ahead_changes_nothing(launch, tmp_path, ahead, undisturbed):
    variables = clock_ahead(tmp_path, seconds=3600)
    for host in launch.hosts:
        host.set_variables(**(variables if host.name == ahead else {}))
    write_campaign(tmp_path / "small.yaml", **SMALL)
    launch.finish("small.yaml")
    (leg,) = read_campaign(tmp_path / "small.h5").legs()
    assert bool(leg["started"] > time.time() + 1800.0) is (ahead == NAMES[0])
    assert 0.0 < leg["stopped"] - leg["started"] < 1800.0
    assert_same(tmp_path / "small.h5", undisturbed)
    assert_sound(tmp_path / "small.h5")


def test_a_job_ends_soon_when_all_processes_of_a_host_are_killed(
    launch, held, tmp_path, undisturbed
):
    process, gate = held
    launch.hosts.second.kill_all()
    output_of(process)
    assert process.returncode not in (0, 2, 75)
    launch.wait_for_end_of_ranks()
    assert_sound(tmp_path / "small.h5")
    gate.open()
    finish(tmp_path, "small.yaml")
    assert_same(tmp_path / "small.h5", undisturbed)
    assert_sound(tmp_path / "small.h5")
