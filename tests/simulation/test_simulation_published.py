"""The published strings against an independent code's numbers, and against plain Python."""

import functools
import itertools
import json
import math
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from processes import output_of, program

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.simulation.engines import AdaptiveSteps
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate

JOB = Path(__file__).parents[2] / "jobs" / "accretion_2003.yaml"
JOB_2004 = JOB.with_name("agglomeration_2004.yaml")

TABLE_1 = [
    (4.326, 0.633, 6141.898, 67.188e6, 1279.542, 0.307, 330.652, 707.351, 5940883.989),
    (4.746, 0.638, 5579.604, 60.730e6, 1170.780, 0.283, 353.865, 598.416, 2347406.359),
    (4.434, 0.637, 5921.768, 62.759e6, 1310.642, 0.292, 349.057, 578.921, 3157762.434),
]
"""[A table 1], first rows, with the activation energy in J/mol."""

TABLE_3 = (
    184.688,
    0.79041,
    6652.7,
    265480.0,
    1796.3,
    1.3456e-3,
    502.18,
    352.41,
    1.7765e6,
    8.3685e15,
)
"""[B tables 1-3], first row, with the reaction heat as table times 1e7."""

# Of an independent implementation: 200 fixed steps, each ± 0.01, and without time-discretisation
# error, ± 0.005 and ± 0.01.
FIXED_STEPS = [2.04, 2.15, 2.09]
EVENTS = [1.942, 2.027, 1.977]
EVENTS_2004 = 2.51


def named(row):
    return dict(zip(TEN.names, row, strict=False))


@functools.cache
def growth(job, row, samples, engine):
    """Mean radius ratio of each sample; all ledgers must close."""
    campaign, ratios = load_campaign(job), []
    for sample in range(samples):
        outcome = simulate(campaign, named(row), sample, engine)
        assert outcome.ledger["momentum_error"] <= 1e-12
        assert abs(outcome.ledger["energy_error"]) <= 1e-10
        assert outcome.ledger["capped_iterations"] == 0
        assert outcome.particles == campaign.scene.particles - outcome.merges
        assert np.mean(outcome.radii) == pytest.approx(outcome.mean_radius_ratio, rel=1e-13)
        ratios.append(outcome.mean_radius_ratio)
    return np.array(ratios)


def mean_and_error(values):
    return values.mean(), values.std(ddof=1) / math.sqrt(len(values))


@pytest.mark.slow
@pytest.mark.parametrize("row", [0, 1, 2])
def test_the_published_strings_grow_as_the_independent_code_says(row):
    mean, error = mean_and_error(growth(JOB, TABLE_1[row], 400, "fixed:200"))
    assert error < 0.02
    assert abs(mean - FIXED_STEPS[row]) <= 4.0 * math.hypot(error, 0.01)


@pytest.mark.slow
@pytest.mark.parametrize("row", [0, 1, 2])
def test_the_event_engine_grows_the_2003_strings_as_an_independent_exact_code(row):
    mean, error = mean_and_error(growth(JOB, TABLE_1[row], 400, "event"))
    assert error < 0.015
    assert abs(mean - EVENTS[row]) <= 4.0 * math.hypot(error, 0.005)


def test_the_event_engine_grows_the_2004_string_as_an_independent_exact_code():
    mean, error = mean_and_error(growth(JOB_2004, TABLE_3, 50, "event"))
    assert error < 0.03
    assert abs(mean - EVENTS_2004) <= 4.0 * math.hypot(error, 0.01)


def adaptive(share):
    """Steps of at least, and at most ten times, this share of the run."""
    campaign = load_campaign(JOB)
    end_time = campaign.scene.build(campaign.parameters(named(TABLE_1[0]))).end_time
    return AdaptiveSteps(floor=share * end_time, ceiling=10.0 * share * end_time)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["fixed", "adaptive"])
def test_shorter_steps_converge_to_the_event_engine(law):
    """The same samples on all engines: paired differences, each with its standard error."""
    exact = growth(JOB, TABLE_1[0], 400, "event")
    biases = []
    for steps, samples in ((200, 400), (1000, 400), (5000, 200)):
        engine = f"fixed:{steps}" if law == "fixed" else adaptive(1.0 / steps)
        stepped = growth(JOB, TABLE_1[0], samples, engine)
        biases.append(mean_and_error(stepped - exact[:samples]))
    for (coarse, coarse_error), (fine, fine_error) in itertools.pairwise(biases):
        assert fine <= coarse + 3.0 * math.hypot(coarse_error, fine_error)
    (coarsest, coarsest_error), _, (finest, finest_error) = biases
    assert coarsest >= 4.0 * coarsest_error
    assert abs(finest) <= 4.0 * finest_error
    assert finest_error < 0.02


TINY = """
import json, sys
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.verbs.simulate import simulate
campaign = Campaign.from_text(sys.argv[2])
outcome = simulate(campaign, json.loads(sys.argv[1]), int(sys.argv[3]))
print(json.dumps([float(value) for value in outcome.record] + outcome.temperatures.tolist()))
"""


SLOW = pytest.mark.slow
FUSED = 1e-9
"""Hits are found with fused products and sums where they are compiled: a rounding of the first
times, 1e-16, grows by travel over radius, ten at most, in each of a few hits."""


@pytest.mark.parametrize(
    ("engine", "cooling", "tolerance"),
    [
        pytest.param("event", "none", FUSED, id="event"),
        pytest.param("event", "quartic", FUSED, id="event, cooling", marks=SLOW),
        pytest.param("{law: fixed, steps: 10}", "quartic", 1e-12, id="fixed", marks=SLOW),
    ],
)
def test_plain_python_computes_the_same_sample_as_the_compiled_code(engine, cooling, tolerance):
    text = JOB.read_text().replace("ratio: 2}", "ratio: 1.5}")
    text = re.sub(r"engine: .*", f"engine: {engine}", text)
    text = re.sub(r"cooling: .*", f"cooling: {cooling}", text)
    string = named(TABLE_1[0]) | {"size_ratio": 0.8, "relative_speed": 30.0}
    if engine == "event":
        text = text.replace("particles: 100", "particles: 9")
        text = text.replace("end_time: characteristic", "end_time: 10 ms")
        string["hardness"] = 4e10
    else:
        text = text.replace("particles: 100", "particles: 5")
    campaign = Campaign.from_text(text)
    outcomes = (simulate(campaign, string, sample) for sample in range(100))
    if engine == "event":  # a sample in which some bounce and some merge
        wanted = (one.collisions > one.merges > 2 for one in outcomes)
    else:
        wanted = (one.collisions > 0 and one.steps == 10 for one in outcomes)
    sample = next(number for number, found in enumerate(wanted) if found)
    words = [sys.executable, "-c", TINY, json.dumps(string), text, str(sample)]
    with program(words, env=os.environ | {"NUMBA_DISABLE_JIT": "1"}) as process:
        said, complaint = output_of(process)
    assert process.returncode == 0, complaint
    outcome = simulate(campaign, string, sample)
    compiled = [float(value) for value in outcome.record] + outcome.temperatures.tolist()
    assert json.loads(said) == pytest.approx(compiled, rel=tolerance, abs=1e-13)
