"""A link between two hosts that is cut: rank 0 names the host it has lost, and does the rest."""

import time

import pytest
from campaign_runs import assert_same, assert_sound, finish
from processes import output_of
from two_host_runs import GONE
from two_hosts import NAMES

pytestmark = pytest.mark.slow


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


def line_with(process, words):
    """Read what a program says on standard error, up to a line with these words; that line."""
    said = []
    for line in process.stderr:
        said.append(line)
        if words in line:
            return line
    raise AssertionError(f"it ended before it said '{words}':\n{''.join(said)}")
