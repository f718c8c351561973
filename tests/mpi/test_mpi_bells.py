"""Ranks of one machine ring for each other; nothing but the time depends on it."""

import time

import pytest
from farm_runs import assert_same, assert_sound, decisions, finish, inject, need_mpirun
from mpi_injections import RANK

HARDLY_LOOKS = """
import agglom_mpi.farm.waiting as waiting

waiting.QUIET = 40.0
"""

OUT_OF_REACH = """
from agglom_mpi.farm.bell import Bell

Bell.ring_at = lambda bell, name: False
"""

LEFT_UNHEARD = f"""{RANK}
import random
from agglom_mpi.farm.bell import Bell

chance, ring, ring_at = random.Random(rank), Bell.ring, Bell.ring_at
Bell.ring = lambda bell: ring(bell) if chance.random() < 0.5 else None
Bell.ring_at = lambda bell, name: ring_at(bell, name) if chance.random() < 0.5 else True
"""


@pytest.fixture(autouse=True)
def mpirun():
    need_mpirun()


@pytest.mark.parametrize("ranks", [1, 2, 3])
def test_whoever_waits_is_woken(small, tmp_path, ranks):
    """Any message that nobody rings for costs forty seconds here, and the campaign takes two."""
    folder = inject(tmp_path / "inject", HARDLY_LOOKS)
    begun = time.monotonic()
    finish(small, "small.yaml", "-o", tmp_path / "woken.h5", ranks=ranks, inject=folder)
    assert time.monotonic() - begun < 40.0
    assert_same(tmp_path / "woken.h5", decisions(small / "small.h5"))


@pytest.mark.parametrize("bells", [OUT_OF_REACH, LEFT_UNHEARD])
def test_without_bells_mail_is_found_all_the_same(small, tmp_path, bells):
    folder = inject(tmp_path / "inject", bells)
    finish(small, "small.yaml", "-o", tmp_path / "quiet.h5", ranks=3, inject=folder)
    assert_same(tmp_path / "quiet.h5", decisions(small / "small.h5"))
    assert_sound(tmp_path / "quiet.h5")
