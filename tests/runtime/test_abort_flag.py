"""Samples that take too long, checks that come too late, and a stop in between."""

import numpy as np
import pytest
from campaign_runs import HARD, SMALL, write_campaign, write_endless
from processes import wait_for

from agglom_mpi import stopwatch
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import COMPLETED, FAILED, OUTCOME, FailureReason
from agglom_mpi.runtime import abort_flag
from agglom_mpi.runtime import task_runner as module
from agglom_mpi.runtime.abort_flag import AbortFlag
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.messages import storable
from agglom_mpi.runtime.simulation_thread import SimulationThread
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.runtime.wakeup import Wakeup
from agglom_mpi.scheduling.interface import task_type
from agglom_mpi.storage.schema import TOOK_TOO_LONG

LONG = 50.0
"""Most seconds of a sample."""


class Clock:
    """A clock that stands still unless a test sets it."""

    now = 100.0

    def monotonic(self):
        return self.now

    time = perf_counter = thread_time = monotonic


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    for each in (module, abort_flag, stopwatch):
        monkeypatch.setattr(each, "time", clock)
    return clock


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    path = write_campaign(tmp_path_factory.mktemp("campaign") / "small.yaml", **SMALL)
    path.write_text(f"{path.read_text().rstrip()}\n  max_seconds: {LONG} s\n")
    return load_campaign(path)


@pytest.fixture
def simulator(campaign, clock):
    return SampleRunner(InversionExperiment(campaign), 2)


class Scenes:
    """Samples that compute nothing and see to it that something happens on the way."""

    def __init__(self, monkeypatch, *acts):
        self.acts, self.seen = list(acts), 0
        monkeypatch.setattr(module, "simulate_scene", self)
        monkeypatch.setattr(module, "MAX_AT_ONCE", 1)

    def __call__(self, scene, random, abort, frames=None):
        act = self.acts.pop(0) if self.acts else None
        self.seen += 1
        if act is not None:
            act()
        record = np.zeros((), OUTCOME)
        record["mean_radius_ratio"], record["particles"] = random.random(), 50
        record["state"] = FAILED if abort[0] else COMPLETED
        if frames is not None:
            frames.particles[:] = 0 if abort[0] else 50
        return record, None


def task(campaign, count, frames=0):
    batch = np.zeros(1, task_type(10))
    batch["string"], batch["first"], batch["count"] = 3, 5, count
    batch["frames"], batch["parameters"] = frames, campaign.parameters()
    return batch


def done(simulator, batch):
    job = simulator.begin(batch[0])
    while job.simulate_next():
        pass
    return job.collect()


def too_long(clock, flag):
    """Take too long, under the eyes of the other thread."""

    def act():
        clock.now += LONG
        flag.check_time()
        assert not flag.abort[0]
        clock.now += 0.01 * LONG
        flag.check_time()
        assert flag.abort[0]

    return act


def test_a_sample_that_takes_too_long_fails_and_the_next_one_runs(
    campaign, clock, simulator, monkeypatch
):
    Scenes(monkeypatch, None, too_long(clock, simulator.abort_flag))
    batch = done(simulator, task(campaign, 3))
    rows, [failure] = batch.results, batch.failures
    assert rows["sample"].tolist() == [5, 6, 7]
    assert rows["state"].tolist() == [COMPLETED, FAILED, COMPLETED]
    assert rows["reason"].tolist() == [0, FailureReason.TIMED_OUT, 0]
    assert rows["particles"].tolist() == [50, 0, 50]
    assert rows["seconds"].tolist() == [0.0, pytest.approx(1.01 * LONG), 0.0]
    assert (failure["string"], failure["sample"], failure["rank"]) == (3, 6, 2)
    assert failure["text"].item().decode() == f"{TOOK_TOO_LONG} {LONG:g} s"
    assert not simulator.abort_flag.abort[0]
    assert storable(rows)["sample"].tolist() == [5, 7], "it may be tried again"


def later(clock):
    clock.now += 2 * LONG


def test_a_sample_that_takes_too_long_fails_though_nobody_checked(
    campaign, clock, simulator, monkeypatch
):
    Scenes(monkeypatch, lambda: later(clock))
    rows = done(simulator, task(campaign, 2)).results
    assert rows["reason"].tolist() == [FailureReason.TIMED_OUT, 0]


def test_a_check_that_was_meant_for_the_sample_before_repeats_the_sample(
    campaign, simulator, monkeypatch
):
    wanted = done(simulator, task(campaign, 2)).results
    undisturbed = Scenes(monkeypatch)
    wanted = done(simulator, task(campaign, 2)).results
    late = Scenes(monkeypatch, lambda: simulator.abort_flag.abort.fill(1))
    batch = done(simulator, task(campaign, 2))
    rows = batch.results
    assert (undisturbed.seen, late.seen) == (2, 3)
    for name in OUTCOME.names:
        assert rows[name].tobytes() == wanted[name].tobytes()
    assert len(batch.failures) == 0


def test_an_exception_is_told_once_though_its_sample_is_repeated(campaign, simulator, monkeypatch):
    def fail_late():
        simulator.abort_flag.abort[0] = 1
        fail()

    def fail():
        raise ArithmeticError("grains on strike")

    Scenes(monkeypatch, fail_late, fail)
    batch = done(simulator, task(campaign, 2))
    rows, [failure] = batch.results, batch.failures
    assert rows["reason"].tolist() == [FailureReason.EXCEPTION, 0]
    assert failure["sample"] == 5


def test_time_between_samples_does_not_count(campaign, clock, simulator, monkeypatch):
    scenes = Scenes(monkeypatch)
    job = simulator.begin(task(campaign, 2)[0])
    assert job.simulate_next()
    later(clock)
    simulator.abort_flag.check_time()
    assert not simulator.abort_flag.abort[0]
    assert not job.simulate_next()
    assert scenes.seen == 2


def test_a_stop_wins_over_a_check(campaign, clock, simulator, monkeypatch):
    flag = simulator.abort_flag

    def both():
        too_long(clock, flag)()
        flag.stop()

    scenes = Scenes(monkeypatch, None, both)
    batch = done(simulator, task(campaign, 3))
    rows = batch.results
    assert rows["sample"].tolist() == [5], "what is stopped never was"
    assert len(batch.failures) == 0
    assert flag.abort[0]
    assert scenes.seen == 2


def test_a_stop_between_samples_is_not_forgotten():
    flag = AbortFlag(1.0)
    flag.begin()
    flag.stop()
    assert flag.end() == (False, True)
    assert flag.abort[0]
    flag.begin()
    assert flag.end() == (False, True)


def test_what_is_given_up_is_no_result_and_has_no_particles(tmp_path):
    path = write_campaign(tmp_path / "kept.yaml", **SMALL)
    path.write_text(f"{path.read_text()}\noutput: {{final_particles: true}}\n")
    campaign = load_campaign(path)
    simulator = SampleRunner(InversionExperiment(campaign), 2)
    job = simulator.begin(task(campaign, 3)[0])
    assert job.simulate_next()
    job.cancel()
    batch = job.collect()
    rows, [final] = batch.results, batch.final_particles
    assert rows["sample"].tolist() == [5]
    assert batch.parts[["first", "size", "left_out"]].tolist() == [(5, 1, True)]
    assert final["sample"] == 5
    assert len(batch.failures) == 0


def test_an_interrupted_sample_is_simulated_again(campaign, simulator, monkeypatch):
    scenes = Scenes(monkeypatch, simulator.abort_flag.interrupt)
    rows = done(simulator, task(campaign, 2)).results
    assert rows["reason"].tolist() == [0, 0]
    assert scenes.seen == 3


def test_without_a_limit_nothing_takes_too_long():
    flag = AbortFlag(None)
    flag.begin()
    flag.check_time()
    assert flag.end() == (False, False)


def test_pictures_are_whole_however_long_ago_the_last_sample_was(
    campaign, clock, simulator, monkeypatch
):
    Scenes(monkeypatch)
    done(simulator, task(campaign, 1))
    later(clock)
    simulator.abort_flag.check_time()
    for act in (None, lambda: simulator.abort_flag.abort.fill(1)):
        scenes = Scenes(monkeypatch, act)
        [rows] = done(simulator, task(campaign, 1, frames=3)).frames
        assert rows["particles"].tolist() == [50] * 3
        assert scenes.seen == (1 if act is None else 2)


def test_pictures_of_a_sample_that_takes_too_long_are_given_up(
    campaign, clock, simulator, monkeypatch
):
    Scenes(monkeypatch, too_long(clock, simulator.abort_flag))
    batch = done(simulator, task(campaign, 2, frames=3))
    [rows], [failure] = batch.frames, batch.failures
    assert rows["sample"].tolist() == [6] * 3
    assert failure["sample"] == 5
    assert failure["text"].item().decode().startswith(TOOK_TOO_LONG)


def test_the_thread_checks_the_time_while_it_is_asked_for_results(tmp_path):
    path = write_endless(tmp_path / "endless.yaml")
    path.write_text(f"{path.read_text().rstrip()}\n  max_seconds: 0.2 s\n")
    campaign = load_campaign(path)
    simulator = SampleRunner(InversionExperiment(campaign), 0)
    simulator.warm_up()
    batch = task(campaign, 2)
    batch["parameters"] = campaign.parameters(HARD)
    thread = SimulationThread(simulator, Wakeup())
    thread.put(batch)
    rows = []
    while sum(map(len, rows)) < 2:
        rows.append(wait_for(thread.poll, "a result").results)
    thread.stop()
    rows = np.concatenate(rows)
    assert rows["sample"].tolist() == [5, 6]
    assert rows["reason"].tolist() == [FailureReason.TIMED_OUT] * 2
    assert np.all(rows["seconds"] > 0.2)
