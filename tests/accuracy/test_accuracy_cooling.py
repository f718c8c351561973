"""The section on cooling: measured limits against exact ones, and what it concludes."""

import itertools
import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from agglom_mpi.accuracy.cooling import PUBLISHED, cooling_section, measure_errors, measure_limits
from agglom_mpi.accuracy.cooling_methods import (
    EXAMPLE_LAW,
    euler,
    exact,
    grain_of,
    least_step,
    linear_limit,
)
from agglom_mpi.physics.contact import ContactArea
from agglom_mpi.physics.cooling import EulerCooling, ExactCooling, QuarticCooling, RadiativeCooling
from agglom_mpi.physics.restitution import ConstantRestitution, ImpactLaws
from agglom_mpi.physics.velocities import UniformX
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.scene import Scene

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


SCENES = [scene(ExactCooling(RADIATION)), scene(EulerCooling(QUARTIC), temperature=300.0)]
BOTH = pytest.mark.parametrize("case", SCENES, ids=["radiation", "quartic"])


@pytest.fixture(scope="module")
def section():
    return cooling_section(SCENES[0], quick=True)


@BOTH
def test_every_number_is_finite_and_euler_errs_with_its_step(case):
    limits, errors = (
        measure_limits(grain_of(case), case, True),
        measure_errors(grain_of(case), case, True),
    )
    assert np.isfinite(limits.to_numpy(float)).all()
    assert np.isfinite(errors.select_dtypes("number").to_numpy(float)).all()
    assert (limits.filter(like="processor time") > 0.0).all(axis=None)
    fine = errors[(errors["run"] == "stiff") & (errors["steps"] == PUBLISHED)]
    assert ((fine["relative error"] > 1e-8) & (fine["relative error"] < 1e-2)).all()
    assert not errors[errors["step over the estimated limit"] < 0.5]["overshoots"].any()
    assert (errors["change in 1000 intervals"] < 1e-12).all()


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
    found = cooling_section(bare, quick=True)
    assert "the values of [B], as an example" in found.setups
    assert "as an example" not in cooling_section(SCENES[0], quick=True).setups


def test_the_conclusions_say_what_the_tables_say(section):
    limits, errors = (table.frame for table in section.tables)
    text = "\n".join(section.conclusions)
    ratios = limits["overshoots from (s)"] / limits["estimated limit (s)"]
    assert len(limits) == len([line for line in section.conclusions if "overshoot" in line])
    for ratio in ratios:
        assert f"({ratio:.3g} times the estimated limit)" in text
    worst = errors[(errors["run"] == "end time") & (errors["steps"] == PUBLISHED)]
    assert f"off by {worst['relative error'].max():.1g} of the temperature" in text
    overshooting = errors[(errors["run"] == "stiff") & errors["overshoots"]]
    assert any(f"stiff runs: {len(overshooting)} of " in line for line in section.failures)
    assert "no step of this scene can oscillate" in text


def test_a_scene_that_lasts_long_is_told_how_many_steps_it_needs():
    grain = grain_of(SCENES[0])
    hottest = 10.0 * 500.0
    end_time = 7.5 * linear_limit(grain, hottest)
    text = "\n".join(cooling_section(SCENES[0]._replace(end_time=end_time), quick=True).conclusions)
    assert "From 5000 K at least 8 steps to the end time are needed" in text


def test_the_figures_and_the_table_can_be_drawn(section):
    for figure in section.figures:
        canvas = Figure(layout="constrained")
        figure.draw(canvas)
        assert canvas.axes[0].get_xlabel()
    for column in section.tables[0].shown:
        assert all(column.text(row) for _, row in section.tables[0].frame.iterrows())
