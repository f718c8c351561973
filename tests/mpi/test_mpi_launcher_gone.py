"""Ranks whose launcher was killed end by themselves, and the file is as after any other stop."""

import sys

import pytest
from campaign_runs import (
    SLOWLY,
    SMALL,
    TINY,
    assert_same,
    assert_sound,
    decisions,
    environment,
    finish,
    inject,
    mpirun_is_hydra,
    need_mpirun,
    samples_in,
    state,
    wait_until,
    write_campaign,
)
from processes import HANG, descendants, program, wait_until_gone

LOOKS_OFTEN = f"""{SLOWLY}
import agglom_mpi.runtime.watches as watches

watches.CHECKED_EVERY = 0.1
"""

STOPS_NOBODY = """
from agglom_mpi.runtime.stop_request import StopRequest

StopRequest.request = lambda self, reason: None
watches.TIME_TO_STOP = 0.5
"""


@pytest.fixture(autouse=True)
def hydra():
    """Go on only with MPICH's launcher, whose ranks have a proxy above them."""
    need_mpirun()
    if not mpirun_is_hydra():
        pytest.skip("only MPICH's launcher has a proxy")


@pytest.fixture
def undisturbed(shared_campaign):
    return decisions(shared_campaign("small") / "small.h5")


def without_launcher(folder, text="", wrapper=()):
    """Kill the proxy in the middle of a campaign, and wait for the end of the ranks."""
    write_campaign(folder / "small.yaml", **SMALL)
    code = inject(folder / "inject", LOOKS_OFTEN + text)
    words = ["mpirun", "-n", "2", *wrapper, "agglom-invert", "small.yaml"]
    with program(words, cwd=folder, env=environment(code)) as process:
        wait_until(lambda: samples_in(folder / "small.h5") > 20, process)
        [proxy, *ranks] = descendants(process)
        assert proxy.name() == "hydra_pmi_proxy"
        proxy.kill()
        wait_until_gone([rank.pid for rank in ranks])


@pytest.mark.ranks(guard="runtime/test_launcher_watch.py")
@pytest.mark.parametrize("wrapper", [(), ("bash", "-c", '"$@"; true', "-")])
def test_a_run_whose_launcher_is_killed_stops_and_can_go_on(undisturbed, tmp_path, wrapper):
    without_launcher(tmp_path, wrapper=wrapper)
    path = tmp_path / "small.h5"
    assert state(path) == ("stopped", "the launcher is gone")
    assert_sound(path)
    finish(tmp_path, "small.yaml", "-q")
    assert_same(path, undisturbed)


@pytest.mark.ranks(guard="runtime/test_launcher_watch.py")
def test_ranks_that_do_not_stop_are_ended_without_a_launcher(tmp_path):
    without_launcher(tmp_path, STOPS_NOBODY)
    assert_sound(tmp_path / "small.h5")


@pytest.mark.slow(guard="runtime/test_launcher_watch.py")
def test_a_plain_run_outlives_whoever_has_started_it(tmp_path):
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    starts = "import subprocess, sys; print(subprocess.Popen(sys.argv[1:]).pid)"
    run = ["agglom-invert", "tiny.yaml", "-q"]
    code = inject(tmp_path / "inject", LOOKS_OFTEN)
    words = [sys.executable, "-c", starts, *run]
    with program(words, cwd=tmp_path, env=environment(code)) as process:
        pid = int(process.stdout.readline())
        process.wait(HANG)
        wait_until_gone([pid])
    assert state(tmp_path / "tiny.h5")[0] == "finished"
