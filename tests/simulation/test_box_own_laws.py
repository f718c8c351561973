"""A box runs laws of one's own as a sample does, and its pickle carries their modules."""

import pickle
import subprocess
import sys

import numpy as np
import pytest
from own_components import SPEED, write_scene
from plain_python import PLAIN, PLAIN_ALONE

from agglom_mpi import Box, load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.verbs.simulate import simulate

ELSEWHERE = """
import pickle, sys
box = pickle.load(sys.stdin.buffer)
box.advance(0.01)
pickle.dump(box.particles.velocities, sys.stdout.buffer)
"""


@PLAIN
def test_a_box_with_a_law_of_one_s_own_goes_on_in_another_process(tmp_path):
    campaign = load_campaign(write_scene(tmp_path), allow_code=True)
    box = Box(campaign, {"relative_speed": 1.0})
    box.advance(0.01)
    there = pickle.dumps(box)
    (tmp_path / "sticking.py").unlink()
    done = subprocess.run(
        [sys.executable, "-c", ELSEWHERE], input=there, capture_output=True, check=True, cwd="/"
    )
    after = box.advance(0.01)
    assert np.array_equal(pickle.loads(done.stdout), box.particles.velocities)
    assert after.collisions > 0


@PLAIN_ALONE
def test_a_box_is_the_sample_of_the_campaign(tmp_path):
    campaign = load_campaign(write_scene(tmp_path), allow_code=True)
    outcome = simulate(campaign, {"relative_speed": 1.0}, 0)
    box = Box(campaign, {"relative_speed": 1.0})
    box.advance(0.3)
    assert outcome.merges > 0
    assert sorted(box.particles.radii) == sorted(outcome.final.radii)


def test_without_leave_a_box_is_refused(tmp_path):
    with pytest.raises(CampaignError, match="--allow-code"):
        Box(write_scene(tmp_path, SPEED))
