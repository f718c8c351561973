"""Looking does not change a bit; a frame is what a run that ended there would leave."""

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from frame_runs import (
    CROWD,
    HARD,
    SCENES,
    SMALL,
    SMALL_TIMES,
    STEPS,
    arrays_of,
    bits,
    bits_of_frame,
    filled,
    looked_at,
    quickstart,
    stepping,
    unseen,
    wrapped,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_python import PLAIN, cases
from processes import output_of, program
from scenes import HALF

from agglom_mpi.outcome import COMPLETED, OUTCOME, FailureReason, final_particles
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.frames import new_frames
from agglom_mpi.simulation.initial_state import scatter
from agglom_mpi.simulation.particles import new_particles
from agglom_mpi.simulation.sample import (
    carry_to_end,
    measure_sample,
    place_grains,
    run_engine,
    without_law,
)

SHARES = st.lists(
    st.one_of(st.sampled_from([0.0, 0.5, 1.0]), st.floats(0.0, 1.0)), max_size=12
).map(sorted)
QUICK = ["quickstart"]
OTHERS = [name for name in SCENES if name not in QUICK]
EACH_ENGINE = ["event", "fixed", "adaptive"]
SLOW = pytest.mark.slow
ALL = pytest.mark.parametrize("name", cases(SCENES, QUICK))


@pytest.mark.parametrize(
    ("examples", "name"),
    [
        (25, "quickstart"),
        *(pytest.param(25, name, marks=SLOW) for name in OTHERS),
        *(pytest.param(2, name, marks=PLAIN) for name in EACH_ENGINE),
    ],
)
def test_looking_does_not_change_a_bit(name, examples):
    scene = SCENES[name]

    @settings(max_examples=examples, derandomize=True, deadline=None)
    @given(seed=st.integers(0, 2**32), shares=SHARES)
    def check(seed, shares):
        record, particles = unseen(scene, seed)
        other, seen, frames = looked_at(scene, seed, np.array(shares) * scene.end_time)
        assert record["state"] == COMPLETED
        assert other.tobytes() == record.tobytes()
        assert bits(seen) == bits(particles)
        assert np.all(frames.particles >= 1)

    check()


@pytest.mark.parametrize(
    "name",
    [
        "quickstart",
        *(pytest.param(n, marks=PLAIN if n in EACH_ENGINE else SLOW) for n in OTHERS),
    ],
)
def test_frames_of_a_coarse_set_are_those_of_a_finer_one(name):
    scene = SCENES[name]
    times = np.linspace(0.0, scene.end_time, 61)
    fine, coarse = (looked_at(scene, 5, each)[2] for each in (times, times[::7]))
    for every, seventh in zip(arrays_of(fine), arrays_of(coarse), strict=True):
        assert every[::7].tobytes() == seventh.tobytes()


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        *(("quickstart", seed) for seed in range(3)),
        pytest.param("event", 0, marks=PLAIN),
        *(
            pytest.param(name, seed, marks=SLOW)
            for name in OTHERS
            for seed in range(3)
            if not name.startswith("fixed") and (name, seed) != ("event", 0)
        ),
    ],
)
def test_a_frame_is_what_a_run_that_ended_then_leaves(name, seed):
    scene = SCENES[name]
    times = np.sort(np.random.default_rng(seed).uniform(0.0, scene.end_time, 12))
    record, _, frames = looked_at(scene, seed, times)
    assert record["collisions"] > 20
    for f, time in enumerate(times):
        _, ended = unseen(scene._replace(end_time=float(time)), seed)
        assert bits_of_frame(frames, f, ended) == bits(ended)


@pytest.mark.plain
@pytest.mark.parametrize("restitution", [0.0, 0.9])
def test_a_frame_at_the_end_of_a_step_is_what_those_steps_leave(restitution):
    scene = stepping(restitution)
    step = scene.end_time / STEPS
    counts = [1, 2, 17, 18, 100, STEPS]
    record, _, frames = looked_at(scene, 2, np.array(counts) * step)
    assert record["collisions"] > 20
    for f, count in enumerate(counts):
        _, ended = unseen(stepping(restitution, count, end_time=count * step), 2)
        assert bits_of_frame(frames, f, ended) == bits(ended)


@pytest.mark.plain
def test_within_a_step_every_particle_goes_straight_to_its_end():
    scene = stepping(0.9)
    step = scene.end_time / STEPS
    record, _, frames = looked_at(scene, 4, step * np.arange(STEPS + 0.5, step=0.25))
    assert record["collisions"] > 20
    turned = 0
    for k in range(STEPS):
        before, *inside, end = (filled(frames, 4 * k + q) for q in range(5))
        turned += np.any(before.velocities != end.velocities)
        for quarter, frame in enumerate(inside, start=1):
            assert frame.velocities.tobytes() == end.velocities.tobytes()
            way = (1.0 - 0.25 * quarter) * step * frame.velocities
            missed = wrapped(frame.positions + way - end.positions)
            np.testing.assert_allclose(missed, 0.0, atol=1e-15 * HALF * 4)
    assert turned > 10  # contacts come first in a step, so the frame at its beginning is before


@ALL
def test_the_first_frame_shows_the_grains_as_they_are_placed(name):
    scene = SCENES[name]
    frame = filled(looked_at(scene, 3, [0.0])[2], 0)
    assert frame.particles == scene.particles
    assert frame.labels.tolist() == list(range(scene.particles))
    assert np.all(frame.grains == 1)
    assert np.all(frame.radii == scene.radius)
    assert np.all(frame.masses == scene.mass)
    assert np.all(frame.temperatures == scene.temperature)
    _, at_once = unseen(scene._replace(end_time=0.0), 3)
    assert at_once.position.T[: scene.particles].tobytes() == frame.positions.tobytes()
    assert np.all(np.abs(frame.velocities) <= scene.velocities.relative_speed)
    rounding = 4e-16 * scene.velocities.relative_speed * 4
    np.testing.assert_allclose(
        at_once.velocity.T[: scene.particles], frame.velocities, rtol=0, atol=rounding
    )


@ALL
def test_the_frame_at_the_end_time_is_the_final_state(name):
    scene = SCENES[name]
    record, particles, frames = looked_at(scene, 6, [0.3 * scene.end_time, scene.end_time])
    final, last = final_particles(scene, particles), filled(frames, 1)
    assert len(final.radii) == record["particles"] == last.particles
    assert bits_of_frame(frames, 1, particles) == bits(particles)
    for each in ("radii", "masses", "grains", "temperatures"):
        assert getattr(last, each).tobytes() == getattr(final, each).tobytes()
    assert final.grains.dtype == np.int64
    assert final.grains.sum() == scene.particles


@pytest.mark.plain
def test_places_that_nobody_is_in_are_empty():
    _, _, frames = looked_at(SCENES["event, all bond"], 1, [0.0, CROWD["end_time"]])
    n = int(frames.particles[1])
    assert 0 < n < CROWD["particles"]
    for each in (frames.positions, frames.velocities, frames.radii, frames.masses):
        assert np.all(np.isnan(each[1, n:]))
        assert not np.any(np.isnan(each[1, :n]))
    assert np.all(np.isnan(frames.temperatures[1, n:]))
    assert np.all(frames.labels[1, n:] == -1)
    assert np.all(frames.grains[1, n:] == 0)


@pytest.mark.plain
def test_a_sample_that_fails_has_the_frames_up_to_there():
    scene = SCENES["event, all bounce"]._replace(engine=EventDriven.Numbers(2))
    times = np.linspace(0.0, scene.end_time, 50)
    record, _, frames = looked_at(scene, 1, times)
    assert record["reason"] == FailureReason.BUDGET_EXCEEDED
    reached = int(np.count_nonzero(frames.particles))
    assert 0 < reached < 50
    assert np.all(frames.particles[:reached] == scene.particles)
    whole = looked_at(SCENES["event, all bounce"], 1, times)[2]
    assert whole.positions[:reached].tobytes() == frames.positions[:reached].tobytes()


def test_frames_need_no_machine_code_of_what_runs_without_them():
    scene = SCENES["quickstart"]
    kernels = (scatter, run_engine, measure_sample)
    unseen(scene, 1)
    before = [getattr(kernel, "signatures", None) for kernel in kernels]
    looked_at(scene, 1, [0.0, 0.5 * scene.end_time, scene.end_time])
    assert [getattr(kernel, "signatures", None) for kernel in kernels] == before


IN_PLAIN_PYTHON = """
import json, sys
sys.path[:0] = json.loads(sys.argv[1])
from frame_runs import SMALL, SMALL_TIMES, looked_at
record, _, frames = looked_at(SMALL, 1, SMALL_TIMES)
print(json.dumps([int(record["merges"]), *(each.tolist() for each in frames if each is not None)]))
"""


def test_plain_python_takes_the_same_frames_as_the_compiled_code():
    """Hits are found with fused products and sums only where they are compiled."""
    words = [sys.executable, "-c", IN_PLAIN_PYTHON, json.dumps([str(Path(__file__).parent)])]
    with program(words, env=os.environ | {"NUMBA_DISABLE_JIT": "1"}) as process:
        said, complaint = output_of(process)
    assert process.returncode == 0, complaint
    merges, *plain = json.loads(said)
    record, _, frames = looked_at(SMALL, 1, SMALL_TIMES)
    assert merges == record["merges"] > 1
    taken = arrays_of(frames)
    for seen, other in zip(taken, plain, strict=True):
        np.testing.assert_allclose(other, seen, rtol=1e-9, atol=1e-13)


def test_more_than_are_kept_in_order_are_followed_by_their_labels():
    """Beyond 4096 the event engine sorts particles by place; labels go with them."""
    scene = quickstart(HARD, particles=5000, size_ratio=0.3, end_time=1e-5)
    times = np.linspace(0.0, scene.end_time, 3)
    record, _, frames = looked_at(scene, 1, times)
    start, _, end = (filled(frames, f) for f in range(3))
    assert not np.array_equal(end.labels, start.labels)
    assert np.array_equal(np.sort(end.labels), start.labels)
    free = np.all(np.abs(end.velocities - start.velocities[end.labels]) < 1e-13, axis=1)
    assert np.count_nonzero(~free) <= 2 * record["collisions"]
    assert np.count_nonzero(free) > 4000
    way = start.positions[end.labels] + scene.end_time * end.velocities - end.positions
    np.testing.assert_allclose(wrapped(way)[free], 0.0, atol=1e-15 * HALF * 10)
    assert unseen(scene, 1)[0].tobytes() == record.tobytes()


@pytest.mark.plain
@pytest.mark.parametrize("name", cases(["event", "adaptive"], ["event"], SLOW))
def test_labels_are_unique_and_never_come_back(name):
    scene = SCENES[name]
    breakups = 0
    for seed in range(4):
        times = np.linspace(0.0, scene.end_time, 400)
        record, _, frames = looked_at(scene, seed, times)
        breakups += record["breakups"]
        gone: set[int] = set()
        before: set[int] = set()
        for f in range(len(times)):
            now = set(filled(frames, f).labels.tolist())
            assert len(now) == frames.particles[f]
            gone |= before - now
            assert not gone & now
            before = now
        assert record["breakups"] == 0 or max(now | gone) >= scene.particles
    assert breakups > 3


@pytest.mark.plain
def test_an_abort_ends_the_frames_too():
    scene = SCENES["event"]
    frames = new_frames(np.linspace(0.0, scene.end_time, 5), scene.particles)
    particles = new_particles(scene, 2 * scene.particles)
    assert place_grains(scene, np.random.default_rng(1), particles, np.zeros(1, np.uint8))
    out = np.zeros(1, OUTCOME)
    carry_to_end(without_law(scene), particles, np.ones(1, np.uint8), out, frames)
    assert frames.particles[0] == scene.particles
    assert np.all(frames.particles[1:] == 0)
