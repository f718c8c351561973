"""The 2003 campaign against an independent code's numbers, and against its own plain Python."""

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from agglom_mpi.campaign import Campaign, load_campaign
from agglom_mpi.variables import NAMES

JOB = Path(__file__).parents[2] / "jobs" / "accretion_2003.yaml"

TABLE_1 = [
    [4.326, 0.633, 6141.898, 67.188e6, 1279.542, 0.307, 330.652, 707.351, 5940883.989],
    [4.746, 0.638, 5579.604, 60.730e6, 1170.780, 0.283, 353.865, 598.416, 2347406.359],
    [4.434, 0.637, 5921.768, 62.759e6, 1310.642, 0.292, 349.057, 578.921, 3157762.434],
]
"""[A table 1], first rows, with the activation energy in J/mol."""

# Of an independent implementation: 200 fixed steps, and without time-discretisation error.
FIXED_STEPS = [2.04, 2.15, 2.09]
EVENTS = 1.942


def named(row):
    return dict(zip(NAMES, row, strict=False))


def mean_and_error(campaign, row, samples, engine=None):
    outcomes = [campaign.simulate(named(row), sample, engine) for sample in range(samples)]
    for outcome in outcomes:
        assert outcome.ledger["momentum_error"] <= 1e-12
        assert abs(outcome.ledger["energy_error"]) <= 1e-10
        assert outcome.ledger["capped_iterations"] == 0
        assert outcome.particles == 100 - outcome.merges
        assert np.mean(outcome.radii) == pytest.approx(outcome.mean_radius_ratio, rel=1e-13)
    growth = np.array([outcome.mean_radius_ratio for outcome in outcomes])
    return growth.mean(), growth.std(ddof=1) / math.sqrt(samples)


@pytest.mark.parametrize("row", [0, 1, 2])
def test_the_published_strings_grow_as_the_independent_code_says(row):
    mean, error = mean_and_error(load_campaign(JOB), TABLE_1[row], 400, "fixed:200")
    assert error < 0.02
    assert abs(mean - FIXED_STEPS[row]) <= 4.0 * math.hypot(error, 0.01)


def test_finer_steps_approach_the_growth_without_discretisation_error():
    campaign = load_campaign(JOB)
    coarse, coarse_error = mean_and_error(campaign, TABLE_1[0], 400, "fixed:200")
    mean, error = mean_and_error(campaign, TABLE_1[0], 100, "fixed:4000")
    assert abs(mean - EVENTS) <= 4.0 * math.hypot(error, 0.005)
    assert coarse - mean >= 2.0 * math.hypot(error, coarse_error)


TINY = """
import json, sys
from agglom_mpi.campaign import Campaign
campaign = Campaign.from_text(sys.stdin.read())
outcome = campaign.simulate(json.loads(sys.argv[1]), 3)
print(json.dumps([float(value) for value in outcome.record] + outcome.temperatures.tolist()))
"""


def test_plain_python_computes_the_same_sample_as_the_compiled_code():
    text = JOB.read_text().replace("particles: 100", "particles: 5")
    text = re.sub(r"engine: .*", "engine: {law: fixed, steps: 10}", text)
    text = text.replace("ratio: 2}", "ratio: 1.5}")
    string = named(TABLE_1[0]) | {"size_ratio": 0.8, "relative_speed": 30.0}
    plain = subprocess.run(
        [sys.executable, "-c", TINY, json.dumps(string)],
        input=text,
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        timeout=120,
    )
    outcome = Campaign.from_text(text).simulate(string, 3)
    assert outcome.steps == 10
    assert outcome.collisions > 0
    compiled = [float(value) for value in outcome.record] + outcome.temperatures.tolist()
    assert json.loads(plain.stdout) == pytest.approx(compiled, rel=1e-12, abs=1e-13)
