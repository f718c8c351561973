"""The number of stretches that a box is run in does not matter; it is run as a sample is."""

import copy
import math
import pickle

import numpy as np
import pytest
from box_runs import BOXES, GAS, QUICKSTART, bits, make
from plain_python import cases

from agglom_mpi import Box
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.verbs.simulate import simulate

INSTANTANEOUS = (
    "time",
    "particles",
    "mean_radius",
    "radius_deviation",
    "mass_density",
    "granular_temperature",
    "mean_temperature",
)
COUNTS = ("collisions", "merges", "breakups")
SLOWEST = "breaking, adaptive"
RATES = ("dissipation_rate", "heat_release_rate", "cooling_rate", "surface_energy_rate")


@pytest.mark.parametrize(
    "name",
    [
        *cases([name for name in BOXES if name != SLOWEST], ["gas"]),
        pytest.param(SLOWEST, marks=pytest.mark.slow),
    ],
)
def test_eight_stretches_are_one_to_the_bit(name):
    time = BOXES[name][2]
    whole, parts = make(name), make(name)
    at_once = whole.advance(time)
    states = [parts.advance(time / 8) for _ in range(8)]
    assert bits(parts) == bits(whole)
    for field in INSTANTANEOUS:
        last, whole_one = getattr(states[-1], field), getattr(at_once, field)
        assert last == whole_one or (math.isnan(last) and math.isnan(whole_one))
    assert states[-1].momentum_density.tobytes() == at_once.momentum_density.tobytes()
    for field in COUNTS:
        assert sum(getattr(state, field) for state in states) == getattr(at_once, field)
    for field in RATES:
        mean = np.mean([getattr(state, field) for state in states])
        assert mean == pytest.approx(getattr(at_once, field), rel=1e-11)
    assert at_once.collisions > 20
    assert (at_once.merges > 0) == (name != "gas")
    assert at_once.breakups == 0 or name.startswith("breaking")


@pytest.mark.slow(guard="simulation/test_box_steps.py::test_eight_stretches_are_one_to_the_bit")
def test_boxes_do_what_they_are_named_for():
    """About one sample in a hundred breaks nothing."""
    for name, (_, _, time) in BOXES.items():
        states = [make(name, sample=sample).advance(time) for sample in range(8)]
        assert (sum(state.merges for state in states) > 0) == (name != "gas")
        assert (sum(state.breakups for state in states) > 0) == name.startswith("breaking")


@pytest.mark.plain
@pytest.mark.parametrize("engine", ["event", "fixed:200"])
def test_a_box_run_to_the_end_time_is_the_sample_of_its_number(engine):
    outcome = simulate(QUICKSTART, {}, 3, engine)
    box = Box(QUICKSTART, sample=3, engine=engine)
    end, merges = float(outcome.record["end_time"]), 0
    for time in np.linspace(0.0, end, 6)[1:]:
        merges += box.advance(time - box.time).merges
    last = box.particles
    assert box.time == pytest.approx(end, rel=1e-15)
    assert merges == outcome.merges > 10
    assert last.radii.tobytes() == outcome.final.radii.tobytes()
    assert last.masses.tobytes() == outcome.final.masses.tobytes()
    assert last.temperatures.tobytes() == outcome.final.temperatures.tobytes()
    np.testing.assert_array_equal(last.grains, outcome.final.grains)


@pytest.mark.plain
def test_fixed_steps_go_on_across_macroscopic_ones_of_any_length():
    end = BOXES["merging, fixed"][2]
    whole, parts = make("merging, fixed"), make("merging, fixed")
    whole.advance(end)
    merges = 0
    for time in end * np.array([0.0123, 0.4, 0.43, 0.9, 1.0]):
        merges += parts.advance(time - parts.time).merges
    assert merges == whole.state.merges > 10
    assert parts.particles.radii.tobytes() == whole.particles.radii.tobytes()
    np.testing.assert_allclose(
        parts.particles.positions, whole.particles.positions, rtol=0, atol=1e-15
    )


@pytest.mark.plain
def test_a_box_that_is_reset_does_the_same_again():
    box = make("merging, event")
    start, first = bits(box), box.advance(2.0**-12)
    once = bits(box)
    assert box.reset().time == 0.0
    assert bits(box) == start != once
    assert str(box.advance(2.0**-12)) == str(first)
    assert bits(box) == once
    drawn = []
    for _ in range(2):
        box.reset()
        box.set(velocities=lambda random, n: random.normal(size=(n, 3)))
        drawn.append(bits(box))
    assert drawn[0] == drawn[1] != start


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda box: pickle.loads(pickle.dumps(box))])
@pytest.mark.parametrize("name", cases(["gas", "merging, fixed"], ["gas"]))
def test_a_copy_goes_on_the_same_and_leaves_the_box_alone(name, copied):
    box = make(name)
    half = BOXES[name][2] / 2
    box.advance(half)
    other = copied(box)
    before = bits(box)
    other.advance(half)
    assert bits(box) == before != bits(other)
    box.advance(half)
    assert bits(box) == bits(other)


def test_states_and_particles_are_compared_by_their_values():
    box, again = Box(GAS), Box(GAS)
    assert box.state == again.state
    assert box.particles == again.particles
    assert box.state != box.advance(0.001)
    assert box.particles != again.particles
    assert box.state != tuple(box.state)


def test_velocities_are_set_between_steps():
    box = Box(GAS)
    box.advance(0.01)
    before = box.particles
    box.set(velocities=-before.velocities)
    assert (box.time, box.state.collisions, box.state.dissipation_rate) == (0.01, 0, 0.0)
    np.testing.assert_allclose(box.particles.velocities, -before.velocities, rtol=0, atol=1e-15)
    np.testing.assert_allclose(box.particles.positions, before.positions, rtol=0, atol=1e-17)
    np.testing.assert_array_equal(box.particles.labels, before.labels)
    box.set(velocities=[3.0, 0.0, 0.0], temperatures=350.0)
    assert box.state.granular_temperature < 1e-30
    assert box.state.mean_temperature == 350.0
    state = box.advance(0.01)
    assert (state.time, state.collisions) == (0.02, 0)
    np.testing.assert_allclose(state.momentum_density / state.mass_density, [3, 0, 0], rtol=1e-14)


def test_setting_what_is_there_changes_nothing_but_roundings():
    # A rounding of 1e-16 grows by travel over radius, ten at most, in each of about two hits.
    set_again, left_alone = Box(GAS), Box(GAS)
    for box in (set_again, left_alone):
        box.advance(2.0**-9)
    set_again.set(velocities=set_again.particles.velocities)
    ends = [box.advance(2.0**-9) for box in (set_again, left_alone)]
    assert ends[0].collisions == ends[1].collisions > 20
    rows = [box.particles for box in (set_again, left_alone)]
    np.testing.assert_allclose(rows[0].velocities, rows[1].velocities, rtol=0, atol=1e-10)


def test_a_budget_that_is_used_up_is_an_error_and_the_box_can_go_on():
    box = Box(GAS, engine=EventDriven(budget=2))
    with pytest.raises(RuntimeError, match="budget was used up at 0"):
        box.advance(0.1)
    reached = box.time
    assert 0.0 < reached < 0.1
    steps = 1
    while box.time < 0.02 and steps < 100:
        steps += 1
        box.advance(min(reached / 4, 0.02 - box.time))
    reference = Box(GAS)
    reference.advance(0.02)
    np.testing.assert_array_equal(box.particles.velocities, reference.particles.velocities)


@pytest.mark.slow
def test_labels_tell_who_is_who_where_many_particles_are_sorted_by_their_place():
    velocities = np.random.default_rng(8).normal(size=(5000, 3))
    box = Box(GAS, radii=1e-4, velocities=velocities)
    for _ in range(2):
        rows = box.particles
        assert sorted(rows.labels) == list(range(5000))
        assert np.any(rows.labels != np.arange(5000))
        np.testing.assert_allclose(rows.velocities, velocities[rows.labels], rtol=0, atol=1e-15)
        box.set(velocities=rows.velocities)
    assert box.advance(1e-3).collisions > 0
