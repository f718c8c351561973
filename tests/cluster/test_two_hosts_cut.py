"""A link that is cut, a rank that is stopped: rank 0 names who is lost, and does the rest.

Unless the launcher, told to by its keepalives, is faster and ends the job, as Open MPI's does.
"""

import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from campaign_runs import (
    SMALL,
    Gate,
    assert_same,
    assert_sound,
    decisions,
    finish,
    need_mpirun,
    state,
    wait_until,
    write_campaign,
)
from processes import output_of
from two_host_runs import GONE, OPEN_MPI, Launch
from two_hosts import CACHES, NAMES, TwoHosts, need_two_hosts

from agglom_mpi.runtime.silence import BEAT_EVERY
from agglom_mpi.runtime.watches import CUT_OFF_AFTER

pytestmark = pytest.mark.parallel_hdf5 if OPEN_MPI else pytest.mark.slow


@pytest.mark.skipif(OPEN_MPI, reason="the launcher ends the job meanwhile: see the other test")
def test_rank_0_names_the_host_of_a_cut_link_and_no_rank_is_left_a_minute_later(
    launch, held, tmp_path, undisturbed
):
    process, gate = held
    first, _ = launch.hosts
    first.cut()
    cut = time.monotonic()
    assert NAMES[1] in line_with(process, "others do its work")
    gate.open()
    launch.wait_for_end_of_ranks(cut + GONE - time.monotonic())
    output_of(process)
    if launch.leaves_the_rest_to_rank_0:
        assert process.returncode == 0
    first.mend()
    finish(tmp_path, "small.yaml")
    assert_same(tmp_path / "small.h5", undisturbed)
    assert_sound(tmp_path / "small.h5")


@pytest.mark.skipif(not OPEN_MPI, reason="the launcher leaves the rest to rank 0: see above")
def test_a_launcher_with_keepalives_ends_all_ranks_within_a_minute_of_a_cut(
    launch, held, tmp_path, undisturbed
):
    process, gate = held
    first, _ = launch.hosts
    first.cut()
    launch.wait_for_end_of_ranks()
    output_of(process)
    assert process.returncode not in (0, 2, 75)
    first.mend()
    assert_sound(tmp_path / "small.h5")
    gate.open()
    finish(tmp_path, "small.yaml")
    assert_same(tmp_path / "small.h5", undisturbed)
    assert_sound(tmp_path / "small.h5")


LINK = "link"
DISTURBANCES = [
    *((LINK, seconds) for seconds in (20, 75)),
    *(("rank 0", 20), ("rank 0", 80), ("rank 1", 60)),
]
"""What is cut or stopped, and for how long, s."""
LAUNCHER_KILLED = "launcher", 0
"""MPICH's process on the second host."""


@pytest.fixture(scope="module")
def disturbed(tmp_path_factory):
    """Disturb each of several campaigns, side by side, every one on two hosts of its own.

    Return the exit codes and the campaign files.
    """
    need_two_hosts()
    need_mpirun()
    cases = [*DISTURBANCES, LAUNCHER_KILLED]
    folders = [tmp_path_factory.mktemp("disturbed") for _ in cases]
    with ThreadPoolExecutor(len(cases)) as pool:
        found = pool.map(disturb, folders, *zip(*cases, strict=True))
        return dict(zip(cases, found, strict=True))


def disturb(folder, what, seconds):
    """Run the small campaign while the link is cut, or a rank is stopped; code and file."""
    hosts = TwoHosts(folder / "shared")
    try:
        launch, gate = Launch("mpirun", hosts, folder), Gate(folder / "gate")
        write_campaign(folder / "small.yaml", **SMALL)
        compiled = {name: os.environ[name] for name in ("HOME", *CACHES) if name in os.environ}
        for host in hosts:
            host.set_variables(inject=gate.folder, **compiled)
        with launch.start("small.yaml") as process:
            wait_until(lambda: gate.held(0) and gate.held(1), process)
            first, second = hosts
            if what == LINK:
                first.cut()
                time.sleep(seconds)
                first.mend()
            elif (what, seconds) == LAUNCHER_KILLED:
                (proxy,) = (each for each in second.processes() if "hydra" in each.name())
                proxy.kill()
                output_of(process)  # while the gate is closed
            else:
                (rank,) = (first if what == "rank 0" else second).ranks()
                rank.send_signal(signal.SIGSTOP)
                time.sleep(seconds)
                rank.send_signal(signal.SIGCONT)
            time.sleep(2.0 * BEAT_EVERY)  # there would be heartbeats to those that have left
            gate.open()
            output_of(process)
            launch.wait_for_end_of_ranks()
        return process.returncode, folder / "small.h5"
    finally:
        hosts.end()


@pytest.mark.skipif(OPEN_MPI, reason="the launcher ends the job meanwhile")
@pytest.mark.parametrize(("what", "seconds"), DISTURBANCES)
def test_rank_0_outlives_ranks_that_have_left(disturbed, what, seconds, shared_campaign):
    code, path = disturbed[what, seconds]
    stopped = what == "rank 0" and seconds > CUT_OFF_AFTER
    assert (code, state(path)[0]) == ((75, "stopped") if stopped else (0, "finished"))
    assert_sound(path)
    finish(path.parent, "small.yaml")
    assert_same(path, decisions(shared_campaign("small") / "small.h5"))


@pytest.mark.skipif(OPEN_MPI, reason="Open MPI ends the ranks of a daemon that is killed")
def test_a_run_stops_when_the_launcher_on_another_host_is_killed(disturbed):
    code, path = disturbed[LAUNCHER_KILLED]
    assert code not in (0, 2)
    assert state(path) == ("stopped", f"the launcher's process on {NAMES[1]} is gone")
    assert_sound(path)


def line_with(process, words):
    """Read what a program says on standard error, up to a line with these words; that line."""
    said = []
    for line in process.stderr:
        said.append(line)
        if words in line:
            return line
    raise AssertionError(f"it ended before it said '{words}':\n{''.join(said)}")
