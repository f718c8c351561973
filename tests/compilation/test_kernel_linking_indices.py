"""Indices of kernels are unsigned, which is right as long as all are within their arrays."""

import os
from pathlib import Path

import pytest
from fresh_kernels import said_by, with_escape
from numba import types

from agglom_mpi import load_campaign
from agglom_mpi.compilation.kernel_linking import COMPILER, LinkingCompiler, unsigned
from agglom_mpi.verbs.simulate import simulate

JOBS = Path(__file__).parents[2] / "jobs"
compiled = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT", "0") != "0" or COMPILER is not LinkingCompiler,
    reason="nothing is compiled, or by a version of Numba whose own pipeline is used",
)

ITEMS = """
import numpy as np
from agglom_mpi.compilation.kernels import kernel

@kernel
def item(x, y, k):
    y[1, k] += x[k]
    return y[1, k]
"""
ASKED = """
import sys
import numpy as np
sys.path.insert(0, ".")
from items import item
print(item(np.arange(3.0), np.ones((2, 3)), 2))
try:
    print(item(np.arange(3.0), np.ones((2, 3)), -1))
except IndexError:
    print("refused")
"""
SAMPLES = """
import sys
from agglom_mpi import load_campaign
campaign = load_campaign(sys.argv[1])
string = campaign.parameters({}, fill="centre")
outcome = campaign.simulate(string, 0, sys.argv[2] or None, frames=2)
print(outcome.record[["mean_radius_ratio", "collisions", "breakups", "steps", "energy_error"]])
"""
SCENES = {
    "pieces in a box with images": ("extremes/always_breaking", "periodic", ""),
    "merges in cells": ("agglomeration_2004", "periodic", ""),
    "faces": ("agglomeration_2004", "reentry", ""),
    "time steps": ("quickstart", "periodic", "fixed:20"),
}


def test_numbers_lose_their_sign_but_literals_and_slices_stay():
    literal = types.literal(1)
    assert unsigned(types.int64) is unsigned(types.int32) is types.uintp
    assert unsigned(types.uint32) is types.uint32
    assert unsigned(types.slice2_type) is types.slice2_type
    assert unsigned(literal) is literal
    assert unsigned(types.Tuple([types.int64, literal])) == types.Tuple([types.uintp, literal])


@compiled
def test_an_index_before_the_start_is_beyond_the_end(tmp_path):
    (tmp_path / "items.py").write_text(ITEMS)
    assert said_by(ASKED, tmp_path).split() == ["3.0", "refused"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder whose kernels check their indices: the first two scenes are of one kind."""
    return tmp_path_factory.mktemp("checked")


@compiled
@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_no_kernel_reaches_out_of_its_arrays(scene, folder):
    job, escape, engine = SCENES[scene]
    path = with_escape(JOBS / f"{job}.yaml", escape, folder)
    campaign = load_campaign(path)
    string = campaign.parameters({}, fill="centre")
    record = simulate(campaign, string, 0, engine or None, frames=2).record
    found = record[["mean_radius_ratio", "collisions", "breakups", "steps", "energy_error"]]
    assert said_by(SAMPLES, folder, path, engine).strip() == str(found)
