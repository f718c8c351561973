"""Ranks of one machine ring for each other; nothing but the time depends on it."""

import pytest
from campaign_runs import assert_same, assert_sound, decisions, finish, inject, need_mpirun
from mpi_injections import RANK, of_ranks, slow

HARDLY_LOOKS = """
import agglom_mpi.runtime.wakeup as waiting

waiting.QUIET = 60.0
"""

OUT_OF_REACH = """
from agglom_mpi.runtime.wakeup import Wakeup

Wakeup.ring_at = lambda wakeup, name: False
"""

LEFT_UNHEARD = f"""{RANK}
import random
from agglom_mpi.runtime.wakeup import Wakeup

chance, ring, ring_at = random.Random(rank), Wakeup.ring, Wakeup.ring_at
Wakeup.ring = lambda wakeup: ring(wakeup) if chance.random() < 0.5 else None
Wakeup.ring_at = lambda wakeup, name: ring_at(wakeup, name) if chance.random() < 0.5 else True
"""


@pytest.fixture(autouse=True)
def mpirun():
    need_mpirun()


@pytest.mark.ranks(
    guard="mpi/test_mpi_same.py::test_decisions_do_not_depend_on_the_number_of_ranks"
)
def test_a_rank_of_two_is_woken(small, tmp_path):
    """A message that nobody rings for is read a minute later here: a few are too many."""
    folder = inject(tmp_path / "inject", HARDLY_LOOKS)
    finish(small, "small.yaml", "-o", tmp_path / "woken.h5", ranks=2, inject=folder)
    assert_same(tmp_path / "woken.h5", decisions(small / "small.h5"))


@pytest.mark.parametrize(
    ("wakeups", "ranks"),
    [
        of_ranks(OUT_OF_REACH, 2, guard="runtime/test_poll_backoff.py"),
        slow(LEFT_UNHEARD, 3),
    ],
)
def test_without_bells_mail_is_found_all_the_same(small, tmp_path, wakeups, ranks):
    folder = inject(tmp_path / "inject", wakeups)
    finish(small, "small.yaml", "-o", tmp_path / "quiet.h5", ranks=ranks, inject=folder)
    assert_same(tmp_path / "quiet.h5", decisions(small / "small.h5"))
    assert_sound(tmp_path / "quiet.h5")
