"""Samples of one compiled call are those of one call each, and end one by one."""

import os
import threading
import time

import numpy as np
import pytest
from plain_python import cases
from processes import HANG
from scenes import SMALL_SCENES

from agglom_mpi.outcome import COMPLETED, FAILED, FailureReason
from agglom_mpi.physics.size_distributions import LognormalDistribution, SizeDistribution
from agglom_mpi.random_streams import generator, key_words
from agglom_mpi.simulation.sample import simulate_samples, simulate_scene
from agglom_mpi.simulation.sample_draws import samples_at_once, thread_stream
from agglom_mpi.simulation.sample_range import new_results, new_watch

KEY = (7, 1, 2, 3)
PLAIN = os.environ.get("NUMBA_DISABLE_JIT", "0") != "0"
MORE_THAN_WILL_END = 2_000 if PLAIN else 1_000_000
"""Samples of a range that is ended; plain Python takes long for the streams of a million."""


def alone(scene, number):
    return simulate_scene(scene, generator(*KEY, number))[0]


def in_a_range(scene, first, count, watch=None):
    results = new_results(count)
    watch = new_watch(np.zeros(1, np.uint8)) if watch is None else watch
    cut = simulate_samples(scene, key_words(KEY), first, watch, results)
    return results, cut


@pytest.mark.parametrize("name", cases(SMALL_SCENES, ["event"]))
def test_a_range_is_sample_after_sample(name):
    results, cut = in_a_range(SMALL_SCENES[name], 3, 6)
    assert not cut
    assert results.finished[0] == 6
    assert {record["state"] for record in results.records} == {COMPLETED}
    for k, record in enumerate(results.records):
        assert record.tobytes() == alone(SMALL_SCENES[name], 3 + k).tobytes()


def first_with_both(scene):
    """Return the first sample of eight in a row of which some fail and some do not."""
    states = [alone(scene, 0)["state"]]
    while len(set(states)) < 2:
        states.append(alone(scene, len(states))["state"])
    return max(0, len(states) - 4)


def test_a_sample_that_fails_is_one_of_its_range():
    """Some need more events than the budget, some have a grain as large as the box."""
    scene = SMALL_SCENES["event"]._replace(end_time=3e-2)
    steps = [int(alone(scene, k)["steps"]) for k in range(8)]
    budget = sorted(steps)[5] // scene.particles
    scarce = scene._replace(engine=scene.engine._replace(budget=budget))
    wide = scene._replace(sizes=LognormalDistribution(1.2), end_time=1e-6)
    for each, reason in (
        (scarce, FailureReason.BUDGET_EXCEEDED),
        (wide, FailureReason.PLACEMENT_JAMMED),
    ):
        first = first_with_both(each)
        records = in_a_range(each, first, 8)[0].records
        failed = records["state"] == FAILED
        assert 0 < failed.sum() < 8
        assert set(records["reason"][failed].tolist()) == {reason}
        for k, record in enumerate(records):
            assert record.tobytes() == alone(each, first + k).tobytes()


def test_samples_take_the_time_of_their_range():
    wall, processor, date = time.monotonic(), time.thread_time(), time.time()
    times = in_a_range(SMALL_SCENES["event"], 0, 20)[0].times
    assert np.all(times["seconds"] > 0.0)
    assert np.all(times["cpu_seconds"] > 0.0)
    assert times["seconds"].sum() <= time.monotonic() - wall
    assert times["cpu_seconds"].sum() <= time.thread_time() - processor
    assert np.all(np.diff(times["finished"]) >= 0.0)
    assert date - 0.1 <= times["finished"][0] <= times["finished"][-1] <= time.time() + 0.1


def test_an_abort_ends_the_sample_under_way_and_keeps_those_before(monkeypatch):
    scene = SMALL_SCENES["event"]
    results, abort = new_results(MORE_THAN_WILL_END), np.zeros(1, np.uint8)

    def end():
        while results.finished[0] < 3:
            time.sleep(1e-4)
        abort[0] = 1

    thread = threading.Thread(target=end)
    thread.start()
    cut = simulate_samples(scene, key_words(KEY), 0, new_watch(abort), results)
    thread.join(HANG)
    finished = int(results.finished[0])
    assert cut
    assert 3 <= finished < MORE_THAN_WILL_END
    assert results.records[finished - 1].tobytes() == alone(scene, finished - 1).tobytes()
    assert not results.records[finished:]["state"].any()


def test_the_sample_under_way_is_known_while_it_runs():
    """Its start is read by another thread, which ends the range when two samples have begun."""
    results, abort, begun = new_results(MORE_THAN_WILL_END), np.zeros(1, np.uint8), np.zeros(1)
    seen = set()

    def watch():
        while len(seen) < 3:
            seen.add(float(begun[0]))
        abort[0] = 1

    thread = threading.Thread(target=watch)
    before = time.monotonic()
    thread.start()
    simulate_samples(SMALL_SCENES["event"], key_words(KEY), 0, new_watch(abort, begun), results)
    thread.join(HANG)
    starts = sorted(seen - {0.0})
    assert len(starts) >= 2
    assert before <= starts[0] <= starts[-1] <= time.monotonic()


def test_no_sample_is_begun_after_the_budget():
    watch = new_watch(np.zeros(1, np.uint8), budget=0.0)
    results, cut = in_a_range(SMALL_SCENES["event"], 0, 5, watch)
    assert not cut
    assert results.finished[0] == 1
    assert results.records[0].tobytes() == alone(SMALL_SCENES["event"], 0).tobytes()


def test_a_sample_that_takes_too_long_has_no_result():
    watch = new_watch(np.zeros(1, np.uint8), max_seconds=0.0)
    results, cut = in_a_range(SMALL_SCENES["event"], 0, 5, watch)
    assert cut
    assert results.finished[0] == 0


class Picky(SizeDistribution):
    """A law that cannot draw what some streams give."""

    def draw(self, random, count):
        if random.random() < 0.5:
            raise ArithmeticError("not these")
        return random.uniform(0.9, 1.1, count)


@pytest.mark.plain
def test_a_law_of_sizes_raises_for_the_first_sample_of_a_range_alone():
    scene = SMALL_SCENES["event"]._replace(sizes=Picky())
    raises, at = [], 0
    while at < 12:
        try:
            results, _ = in_a_range(scene, at, 12 - at)
        except ArithmeticError:
            raises.append(at)
            at += 1
            continue
        for k in range(int(results.finished[0])):
            assert results.records[k].tobytes() == alone(scene, at + k).tobytes()
        at += int(results.finished[0])
    assert raises == [k for k in range(12) if generator(*KEY, k).random() < 0.5]
    assert 0 < len(raises) < 12


@pytest.mark.parametrize("name", cases(["event", "event, different sizes"], ["event"]))
def test_where_the_generator_cannot_be_written_samples_come_one_by_one(monkeypatch, name):
    scene = SMALL_SCENES[name]
    wanted = [alone(scene, k).tobytes() for k in range(2)]
    assert samples_at_once(scene) > 1000
    monkeypatch.setattr(thread_stream(), "is_open", False)
    monkeypatch.setattr(thread_stream(), "words", np.zeros(4, np.uint64))
    assert samples_at_once(scene) == 1
    for k in range(2):
        assert in_a_range(scene, k, 1)[0].records[0].tobytes() == wanted[k]


@pytest.mark.plain
def test_scenes_of_several_kinds_come_in_any_order():
    wanted = {name: alone(scene, 5).tobytes() for name, scene in SMALL_SCENES.items()}
    for name in [*SMALL_SCENES, *reversed(SMALL_SCENES)]:
        other = SMALL_SCENES[name]._replace(end_time=1e-4)
        in_a_range(other, 0, 1)
        assert in_a_range(SMALL_SCENES[name], 5, 1)[0].records[0].tobytes() == wanted[name]


def test_the_particles_of_a_sample_stay_what_they_are():
    _, particles = simulate_scene(SMALL_SCENES["event"], generator(*KEY, 0))
    before = particles.records.tobytes()
    in_a_range(SMALL_SCENES["event"], 1, 3)
    simulate_scene(SMALL_SCENES["event"], generator(*KEY, 4))
    assert particles.records.tobytes() == before
