"""Ranks leave out what they hold of strings that need no more samples."""

from collections import Counter

import numpy as np
import pytest
from campaign_runs import (
    SLOWLY,
    SMALL,
    assert_same,
    assert_sound,
    decisions,
    finish,
    inject,
    need_mpirun,
    write_campaign,
)
from mpi_injections import RANK, slow

from agglom_mpi.storage.reader import read_campaign

CONVERGING = SMALL | {"generations": 2, "tolerance": 0.1, "max_samples": 100}

LEFT_OUT = f"""{RANK}
{SLOWLY}
import agglom_mpi.runtime.task_runner as simulator

cancel = simulator.Task.cancel

def noted(self):
    with open("left-out-" + rank, "a") as file:
        file.write(f"{{self._string}} {{self._first + self._done}}\\n")
    cancel(self)

simulator.Task.cancel = noted
"""


@pytest.fixture(scope="module")
def wanted(tmp_path_factory):
    """Decisions of a plain run."""
    need_mpirun()
    folder = tmp_path_factory.mktemp("plain")
    write_campaign(folder / "plain.yaml", **CONVERGING)
    finish(folder, "plain.yaml")
    return decisions(folder / "plain.h5")


@pytest.mark.parametrize("ranks", [slow(3), slow(8)])
def test_a_rank_leaves_out_what_nobody_needs_and_the_same_is_decided(tmp_path, wanted, ranks):
    write_campaign(tmp_path / "slow.yaml", **CONVERGING)
    finish(tmp_path, "slow.yaml", ranks=ranks, inject=inject(tmp_path / "inject", LEFT_OUT))
    assert_same(tmp_path / "slow.h5", wanted)
    assert_sound(tmp_path / "slow.h5")
    file = read_campaign(tmp_path / "slow.h5")
    rows = file.all_sample_rows()
    used = {int(row["string"]): int(row["samples_used"]) for row in file.result_rows()}
    stored = Counter(rows["string"].tolist())
    left_out = []
    for path in tmp_path.glob("left-out-*"):
        left_out += [line.split() for line in path.read_text().splitlines()]
    for string, sample in left_out:
        assert int(sample) >= used.get(int(string), 0)
        assert stored[int(string)] >= used.get(int(string), 0)
    if ranks > 1:
        assert left_out
    assert np.all(file.legs()["samples"] == len(rows))
