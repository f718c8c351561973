"""Ranks leave out what they hold of strings that need no more samples."""

from collections import Counter

import numpy as np
import pytest
from farm_runs import (
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
from mpi_injections import RANK

from agglom_mpi.database.reader import open_campaign
from agglom_mpi.farm.messages import NOT_NEEDED

CONVERGING = SMALL | {"tolerance": 0.1, "max_samples": 100}

LEFT_OUT = f"""{RANK}
{SLOWLY}
import agglom_mpi.farm.simulator as simulator

give_up = simulator.Job.give_up

def noted(self):
    with open("left-out-" + rank, "a") as file:
        file.write(f"{{self._string}} {{self._first + self._done}}\\n")
    give_up(self)

simulator.Job.give_up = noted
"""


@pytest.mark.parametrize("ranks", [1, 3, 8])
def test_a_rank_leaves_out_what_nobody_needs_and_the_same_is_decided(tmp_path, ranks):
    if ranks > 1:
        need_mpirun()
    write_campaign(tmp_path / "plain.yaml", **CONVERGING)
    finish(tmp_path, "plain.yaml")
    write_campaign(tmp_path / "slow.yaml", **CONVERGING)
    finish(tmp_path, "slow.yaml", ranks=ranks, inject=inject(tmp_path / "inject", LEFT_OUT))
    assert_same(tmp_path / "slow.h5", decisions(tmp_path / "plain.h5"))
    assert_sound(tmp_path / "slow.h5")
    file = open_campaign(tmp_path / "slow.h5")
    rows = file.all_sample_rows()
    assert NOT_NEEDED not in rows["reason"]
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
