"""A few spheres before chaos sets in: engines against exact trajectories."""

import math

import numpy as np
import pytest
from few_body_reference import (
    END_TIME,
    FRICTION,
    HALF_WIDTH,
    HEAD_ON_RESTITUTION,
    LONGEST_DELAY,
    MASS,
    RADIUS,
    SPEED,
    Sphere,
    bonding,
    bouncing,
    exact_end,
    exact_restitution,
    exact_trajectory,
    initial_states,
)
from few_body_study import EDGE, StudySettings, convergence_order, orders, study

SETTINGS = StudySettings((100, 300, 1000, 3000), (1e-5, 1e-6, 1e-7), 48)
SCENES = {scene.name: scene for scene in (*bouncing(), *bonding())}


@pytest.fixture(scope="module")
def frame():
    return study(bouncing(), SETTINGS, np.random.default_rng(1))


def spheres(positions, velocities, radius=1.0, mass=1.0):
    wide = np.longdouble
    return [
        Sphere(np.array(r, wide), np.array(v, wide), wide(radius), wide(mass))
        for r, v in zip(positions, velocities, strict=True)
    ]


def of_scene(scene, delay=0.0):
    starts = initial_states(scene, np.array([delay]))
    return spheres(starts.position[0].T, starts.velocity[0].T, RADIUS, MASS)


def always(value):
    return lambda approach, reduced, radius: value


# the exact trajectory


def test_head_on_impact_is_the_one_calculated_by_hand():
    pair = spheres([[-3, 0, 0], [3, 0, 0]], [[1, 0, 0], [-1, 0, 0]])
    assert exact_trajectory(pair, always(0.5), 0.3, 100.0, 5.0) == 1
    assert pair[0].position[0] == pytest.approx(-1.0 - 0.5 * 3.0)  # touch at 2 s, then 3 s at e
    assert pair[1].velocity[0] == pytest.approx(0.5)


def test_oblique_impact_with_friction_is_the_one_calculated_by_hand():
    # Centres at 45° at contact: approach and slip are both √½, the impulse is ½(1 + e) of it.
    pair = spheres([[-3, 0, 0], [0, -math.sqrt(2.0), 0]], [[1, 0, 0], [0, 0, 0]])
    exact_trajectory(pair, always(0.6), 0.2, 100.0, 10.0)
    normal, tangent = np.array([1.0, -1.0]) / math.sqrt(2.0), np.array([1.0, 1.0]) / math.sqrt(2.0)
    push = 0.8 * math.sqrt(0.5) * (normal + 0.2 * tangent)
    assert pair[1].velocity[:2].astype(float) == pytest.approx(push, rel=1e-14)


def test_friction_stops_the_slip_and_does_not_turn_it_round():
    pair = spheres([[-3, 0, 0], [0, -math.sqrt(2.0), 0]], [[1, 0, 0], [0, 0, 0]])
    exact_trajectory(pair, always(0.6), 5.0, 100.0, 10.0)
    tangent = np.array([1.0, 1.0, 0.0]) / math.sqrt(2.0)
    assert float((pair[0].velocity - pair[1].velocity) @ tangent) == pytest.approx(0.0, abs=1e-16)


def test_spheres_that_pass_with_a_gap_do_not_collide():
    pair = spheres([[-3, 0, 0], [0, 2.01, 0]], [[1, 0, 0], [0, 0, 0]])
    assert exact_trajectory(pair, always(1.0), 0.0, 100.0, 10.0) == 0


def test_elastic_flight_runs_backwards_to_where_it_began():
    run = of_scene(SCENES["three in sequence"])
    begin = [sphere.position.copy() for sphere in run]
    assert exact_trajectory(run, always(1.0), 0.0, HALF_WIDTH, END_TIME) == 2
    for sphere in run:
        sphere.velocity = -sphere.velocity
    assert exact_trajectory(run, always(1.0), 0.0, HALF_WIDTH, END_TIME) == 2
    for sphere, position in zip(run, begin, strict=True):
        assert np.max(np.abs(sphere.position - position)) < 1e-14 * HALF_WIDTH


def test_bonding_keeps_momentum_volume_and_centre_of_mass():
    pair = spheres([[-3, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 0, 0]])
    assert exact_trajectory(pair, always(0.0), 0.0, 100.0, 4.0) == 1
    assert len(pair) == 1
    assert pair[0].velocity.astype(float) == pytest.approx([0.5, 0.0, 0.0])
    assert pair[0].position.astype(float) == pytest.approx([-1.5 + 4.0 * 0.5, 0.5, 0.0])
    assert float(pair[0].radius) == pytest.approx(2.0 ** (1.0 / 3.0))


def test_a_place_in_the_periodic_box_makes_no_difference():
    scene = SCENES["across a corner"]
    moved = scene._replace(position=scene.position - HALF_WIDTH)
    here, there = of_scene(scene), of_scene(moved)
    for run in (here, there):
        assert exact_trajectory(run, always(0.7), FRICTION, HALF_WIDTH, END_TIME) == 1
    for a, b in zip(here, there, strict=True):
        assert np.max(np.abs(a.velocity - b.velocity)) < 1e-14 * SPEED


# the scenes


@pytest.mark.parametrize("name", SCENES)
def test_scene_has_its_impacts_whatever_the_delay(name):
    scene = SCENES[name]
    impacts = {"cradle of five": 4, "three in sequence": 2, "two pairs": 2, "bond, then bounce": 2}
    friction = FRICTION if scene.restitution is not None else 0.0
    for delay in (0.0, 0.5 * LONGEST_DELAY, LONGEST_DELAY):
        run = of_scene(scene, delay)
        assert exact_trajectory(
            run, exact_restitution(scene), friction, HALF_WIDTH, END_TIME
        ) == impacts.get(name, 1)
        assert len(run) == len(scene.position) - (scene.restitution is None)


def test_a_delayed_start_ends_where_the_flight_is_that_much_earlier():
    scene, delay = SCENES["three in sequence"], 0.3 * LONGEST_DELAY
    position, velocity = exact_end(scene, initial_states(scene, np.array([delay])), 0)
    earlier = of_scene(scene)
    exact_trajectory(earlier, exact_restitution(scene), FRICTION, HALF_WIDTH, END_TIME - delay)
    for k, sphere in enumerate(earlier):
        apart = position[:, k] - sphere.position
        assert np.max(np.abs(apart - EDGE * np.round(apart / EDGE))) < 1e-14 * EDGE
        assert np.max(np.abs(velocity[:, k] - sphere.velocity)) < 1e-13 * SPEED


# the engines


@pytest.mark.plain
def test_few_runs_of_two_spheres_are_as_exact_as_many():
    settings = StudySettings((100, 400), (1e-5, 1e-6), 6)
    head_on = study([SCENES["head-on"]], settings, np.random.default_rng(1))
    bonds = study([SCENES["bond, then bounce"]], StudySettings((), (), 6), np.random.default_rng(2))
    for rows in (head_on[head_on["engine"] == "event"], bonds):
        assert rows["position error, largest"].max() < 1e-14
        assert rows["velocity error, largest"].max() < 1e-13
        assert not rows["other bonds"].any()
    coarse, fine = head_on[head_on["engine"] == "fixed"]["position error"]
    assert fine < coarse
    # Few runs have a last step that a floor makes too long: a hundredth of 400 equal steps.
    adaptive = head_on[head_on["engine"] == "adaptive"]
    assert adaptive["position error"].max() < fine


@pytest.mark.slow
def test_event_engine_is_exact_to_rounding(frame):
    rows = frame[frame["engine"] == "event"]
    assert len(rows) == len(bouncing())
    assert rows["position error, largest"].max() < 1e-14
    assert rows["velocity error, largest"].max() < 1e-13
    assert not rows["other bonds"].any()


@pytest.mark.slow
def test_event_engine_bonds_and_bounces_exactly():
    rows = study(bonding(), StudySettings((), (), 48), np.random.default_rng(2))
    assert rows["position error, largest"].max() < 1e-14
    assert rows["velocity error, largest"].max() < 1e-13
    assert not rows["other bonds"].any()


@pytest.mark.slow
def test_fixed_steps_converge_with_first_order(frame):
    fits = orders(frame)
    fits = fits[fits["engine"] == "fixed"]
    assert len(fits) == len(bouncing())
    for _, fit in fits.iterrows():
        error = fit["position, order, standard error"]
        assert error < 0.1
        assert abs(fit["position, order"] - 1.0) < 4.0 * error


@pytest.mark.slow
def test_adaptive_steps_converge_with_first_order_where_they_see_the_impact(frame):
    fits = orders(frame).set_index(["engine", "scene"])
    for scene in ("head-on", "oblique", "across a corner"):
        fit = fits.loc[("adaptive", scene)]
        assert abs(fit["position, order"] - 1.0) < 4.0 * fit["position, order, standard error"]


@pytest.mark.slow
def test_adaptive_steps_do_not_see_who_is_no_nearest_neighbour(frame):
    rows = frame[(frame["engine"] == "adaptive") & (frame["scene"] == "two pairs")]
    # Seen a tenth of a diameter before they touch, they are late by up to the longest step, in
    # which they come half a diameter closer: 0.05 box edges.
    assert np.all(rows["position error"] > 0.01)
    fit = orders(rows).iloc[0]
    assert abs(fit["position, order"]) < 4.0 * fit["position, order, standard error"]


@pytest.mark.slow
def test_what_the_shift_leaves_of_a_late_impact_is_a_quarter_of_a_step(frame):
    rows = frame[(frame["engine"] == "fixed") & (frame["scene"] == "head-on")]
    expected = HEAD_ON_RESTITUTION * SPEED * rows["step (s)"] / 4.0 / EDGE
    away = np.abs(rows["position error"] - expected)
    assert np.all(away < 4.0 * rows["position error, standard error"])


@pytest.mark.slow
def test_velocities_of_impacts_in_line_do_not_depend_on_the_step(frame):
    rows = frame[frame["scene"].isin(("head-on", "cradle of five"))]
    assert rows["velocity error, largest"].max() < 1e-13
    assert orders(rows)["velocity, order"].isna().all()


# the numbers made of them


def test_fit_finds_the_power_and_its_error():
    random = np.random.default_rng(3)
    steps = np.array([1.0, 0.5, 0.2, 0.1, 0.05, 0.02])
    noise, pulls = 0.05, []
    for _ in range(2000):
        errors = 3.0 * steps**1.5 * np.exp(noise * random.normal(size=len(steps)))
        power = convergence_order(steps, errors, noise * errors)
        pulls.append((power.order - 1.5) / power.standard_error)
    assert abs(np.mean(pulls)) < 4.0 / math.sqrt(2000)
    # The larger of two errors is taken, so that a pull is at most what the known error makes it.
    assert 0.5 < np.std(pulls) < 1.0 + 4.0 / math.sqrt(2.0 * 2000)
