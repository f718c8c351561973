"""A link between two hosts that is cut: rank 0 names the host it has lost, and does the rest.

Unless the launcher, told to by its keepalives, is faster and ends the job, as Open MPI's does.
"""

import time

import pytest
from campaign_runs import assert_same, assert_sound, finish
from processes import output_of
from two_host_runs import GONE, OPEN_MPI
from two_hosts import NAMES

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


def line_with(process, words):
    """Read what a program says on standard error, up to a line with these words; that line."""
    said = []
    for line in process.stderr:
        said.append(line)
        if words in line:
            return line
    raise AssertionError(f"it ended before it said '{words}':\n{''.join(said)}")
