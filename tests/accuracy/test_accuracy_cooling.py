"""Euler steps of cooling against the exact solution: limits, orders, and the map of both."""

import itertools
import math

import numpy as np
import pytest
from accuracy_rows import frame_of

from agglom_mpi.accuracy.maps.law_references import (
    EXAMPLE_LAW,
    euler,
    exact,
    grain_of,
    linear_limit,
)
from agglom_mpi.accuracy.maps.laws import EULER, EXACT, CoolingPlane, cooled_grain, law_section
from agglom_mpi.accuracy.maps.scene import map_scene
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.physics.contact import ContactArea
from agglom_mpi.physics.cooling import EulerCooling, ExactCooling, QuarticCooling, RadiativeCooling
from agglom_mpi.physics.restitution import ConstantRestitution, ImpactLaws
from agglom_mpi.physics.velocities import UniformX
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.scene import Scene

pytestmark = pytest.mark.plain

B = 5.670374419e-8
RADIATION = RadiativeCooling.Numbers(0.5, 300.0, 0.0, 300.0, 300.0)
QUARTIC = QuarticCooling.Numbers(5000.0, 1000.0, 300.0)


def scene(cooling, capacity=1000.0, temperature=500.0, end_time=0.01):
    laws = ImpactLaws(
        ConstantRestitution.Numbers(0.5), None, ContactArea.Numbers(0.0, 1.0), *[None] * 6, capacity
    )
    return Scene(
        escape=Periodic.Numbers(),
        velocities=UniformX.Numbers(1.0),
        laws=laws,
        cooling=cooling,
        engine=EventDriven.Numbers(1000),
        particles=10,
        half_width=0.01,
        radius=1e-3,
        mass=5000.0 * 4.0 / 3.0 * math.pi * 1e-9,
        temperature=temperature,
        end_time=end_time,
    )


STEPS = 200
"""Steps in which a step size has to show that it overshoots."""


def least_step(grain, temperature, flaw, guess):
    """Return the shortest step in s with which Euler steps have a flaw of `EulerRun`; else nan.

    It is searched within a factor of a thousand of `guess`, then bisected to rounding.
    """

    def flawed(step):
        return bool(getattr(euler(grain, temperature, step, STEPS), flaw))

    steps = guess * np.logspace(-3.0, 3.0, 241)
    flaws = [flawed(step) for step in steps]
    if not any(flaws) or flaws[0]:
        return math.nan
    first = flaws.index(True)
    low, high = float(steps[first - 1]), float(steps[first])
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if flawed(middle) else (middle, high)
    return high


SCENES = [scene(ExactCooling(RADIATION)), scene(EulerCooling(QUARTIC), temperature=300.0)]
BOTH = pytest.mark.parametrize("case", SCENES, ids=["radiation", "quartic"])


@pytest.fixture(scope="module")
def section():
    campaign = load_campaign("jobs/accuracy/agglomeration_2004_row_1.yaml")
    return law_section(CoolingPlane(map_scene(campaign, {}, 100, 1000)), quick=True)


@pytest.fixture(scope="module")
def cells(section):
    return frame_of(section.tables[1]).set_index("method")


def test_exact_cooling_does_not_depend_on_its_intervals(cells):
    own = cells.loc[EXACT]
    assert (own["trouble"] == "").all()
    assert (own["relative error of θ"] < 1e-12).all()


def test_short_euler_steps_are_sound_and_err_and_long_ones_fail(cells):
    own = cells.loc[EULER]
    step = own["step over the estimated limit"]
    short, long = own[step < 0.5], own[step > 20.0]
    assert (short["trouble"] == "").all()
    assert ((short["relative error of θ"] > 1e-9) & (short["relative error of θ"] < 0.3)).all()
    assert (long["trouble"] != "").all()
    assert set(own["trouble"]) == {"", "overshoots", "below 0 K"}


@BOTH
def test_a_grain_that_steps_over_the_rest_is_marked_as_its_run_is(case):
    grain = grain_of(case)
    start = 3.0 * grain.rest
    limit = linear_limit(grain, start)
    for step in (0.1, 1.0, 10.0):
        found = cooled_grain(grain, start, step)[EULER]
        run = euler(grain, start, step * limit, max(1, math.ceil(10.0 / step)))
        assert (found.trouble != "") == (run.overshoots or run.negative)
        assert (found.trouble == "below 0 K") == run.negative


@pytest.mark.parametrize("factor", [1.01, 3.0, 30.0])
def test_the_measured_limits_of_radiation_are_those_of_its_first_step(factor):
    grain = grain_of(SCENES[0])
    start = factor * 300.0
    limit = linear_limit(grain, start)
    expected = grain.capacity / (4.0 * B * 0.5 * grain.surface * start**3)
    assert limit == pytest.approx(expected, rel=1e-14)
    slope = (1.0 - 1.0 / factor**4) / 4.0  # rate over start, times the limit
    overshoots = least_step(grain, start, "overshoots", limit)
    assert overshoots == pytest.approx((1.0 - 1.0 / factor) / slope * limit, rel=1e-10)
    negative = least_step(grain, start, "negative", limit)
    assert overshoots < negative <= limit / slope * (1.0 + 1e-10)
    if factor > 10.0:  # from far above the first step goes below zero, if any does
        assert negative == pytest.approx(limit / slope, rel=1e-10)
        assert negative == pytest.approx(4.0 * limit, rel=1e-5)


def test_the_measured_limit_of_the_quartic_law_is_four_times_the_estimate():
    grain = grain_of(SCENES[1])
    limit = linear_limit(grain, 400.0)
    assert limit == pytest.approx(5e6 / (4.0 * B * 1e6), rel=1e-14)
    assert least_step(grain, 400.0, "overshoots", limit) == pytest.approx(4.0 * limit, rel=1e-10)
    # Held at the start, it is judged by its first free step.
    assert least_step(grain, 400.0, "negative", limit) == pytest.approx(16.0 * limit, rel=1e-10)


def test_a_flaw_that_no_step_has_is_not_found():
    grain = grain_of(SCENES[0])
    assert math.isnan(least_step(grain, 100.0, "negative", 1e-6))


@BOTH
def test_euler_converges_to_the_exact_temperature_with_first_order(case):
    grain = grain_of(case)
    end = linear_limit(grain, 900.0)
    reference = exact(grain, 900.0, end)
    errors = [
        euler(grain, 900.0, end / steps, steps).temperature - reference
        for steps in (1000, 2000, 4000)
    ]
    for coarse, fine in itertools.pairwise(errors):
        assert coarse / fine == pytest.approx(2.0, abs=0.01)


def test_a_scene_without_cooling_takes_the_published_radiation_as_an_example():
    bare = scene(None, capacity=math.inf, temperature=0.0)
    grain = grain_of(bare)
    assert grain.law == EXAMPLE_LAW == RADIATION
    assert grain.capacity == pytest.approx(1000.0 * bare.mass, rel=1e-15)
