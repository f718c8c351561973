"""Prefetching reads what the next events need, within its arrays, and changes no result."""

from pathlib import Path

import numpy as np
import pytest
from fresh_kernels import said_by, with_escape
from numba import njit

from agglom_mpi import load_campaign
from agglom_mpi.compilation.kernels import kernel, prefetch, runs_compiled
from agglom_mpi.simulation.event_driven.cell_crossing import next_cell
from agglom_mpi.simulation.event_driven.prefetching import PREFETCH_ABOVE, cells_behind, match_above
from agglom_mpi.verbs.simulate import simulate

JOBS = Path(__file__).parents[2] / "jobs"
compiled = pytest.mark.skipif(not runs_compiled(), reason="nothing is compiled")

SAMPLE = """
import os, sys
from agglom_mpi import load_campaign
from agglom_mpi.simulation.event_driven import prefetching

os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # no other process compiles the engine
prefetching.PREFETCH_ABOVE = 0
campaign = load_campaign(sys.argv[1])
outcome = campaign.simulate(campaign.parameters({}, fill="centre"), 0, frames=2)
print(outcome.record[["mean_radius_ratio", "collisions", "breakups", "steps", "energy_error"]])
"""


@kernel
def asked_ahead(values, i):
    prefetch(values, i)
    return values[i]


@kernel
def around_event(index, face, per_axis):
    return cells_behind(index, face), next_cell(index, face, per_axis)[0]


@kernel
def match_of(node, matches):
    return match_above(node, matches)


def test_prefetching_changes_nothing():
    values = np.arange(10.0)
    assert asked_ahead(values, 7) == 7.0
    assert values.tolist() == list(range(10))


@compiled
def test_prefetching_is_an_instruction():
    # Compiled here: of a kernel that another test saved, Numba knows the machine code alone.
    here = njit(asked_ahead.py_func)
    here(np.arange(2.0), 1)
    assert "llvm.prefetch" in "".join(here.inspect_llvm().values())


@pytest.mark.parametrize(("face", "step"), [(0, -1), (1, 1)])
def test_after_a_crossing_the_cells_behind_the_next_are_looked_at(face, step):
    (first, last), entered = around_event(5, face, 10)
    assert entered == 5 + step
    assert first == last == entered + step


@pytest.mark.parametrize("face", [-1, 2, 6])
def test_otherwise_those_beside_are(face):
    (first, last), _ = around_event(5, face, 10)
    assert (first, last) == (4, 6)


def test_a_match_above_is_the_one_that_the_way_to_the_root_goes_through():
    for node in range(1024, 2048):
        assert match_of(node, 256) == node // 4
        assert match_of(node, 16) == node // 64
    assert match_of(200, 256) == 200  # few particles have no such match


@compiled
@pytest.mark.slow
def test_results_do_not_depend_on_prefetching(tmp_path):
    path = with_escape(JOBS / "agglomeration_2004.yaml", "periodic", tmp_path)
    campaign = load_campaign(path)
    assert campaign.scene.particles < PREFETCH_ABOVE
    outcome = simulate(campaign, campaign.parameters({}, fill="centre"), 0, frames=2)
    without = outcome.record[
        ["mean_radius_ratio", "collisions", "breakups", "steps", "energy_error"]
    ]
    assert said_by(SAMPLE, tmp_path, path).strip() == str(without)
