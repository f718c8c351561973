"""Samples that take too long, looks that come too late, and a stop in between."""

import time

import numpy as np
import pytest
from farm_runs import SMALL, write_campaign

from agglom_mpi.campaign import load_campaign
from agglom_mpi.database.schema import TOOK_TOO_LONG
from agglom_mpi.farm import simulator as module
from agglom_mpi.farm.bell import Bell
from agglom_mpi.farm.messages import NOT_NEEDED, TASK, final_results
from agglom_mpi.farm.simulator import Batch, Simulator, Watch
from agglom_mpi.farm.thread import SimulatorThread
from agglom_mpi.farm.work import CampaignWork
from agglom_mpi.simulation.outcome import COMPLETED, EXCEPTION, FAILED, OUTCOME, TIMED_OUT

LONG = 0.05
"""Most seconds of a sample."""


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    path = write_campaign(tmp_path_factory.mktemp("campaign") / "small.yaml", **SMALL)
    path.write_text(f"{path.read_text().rstrip()}\n  max_seconds: {LONG} s\n")
    return load_campaign(path)


@pytest.fixture
def simulator(campaign):
    return Simulator(CampaignWork(campaign), 2)


class Scenes:
    """Samples that compute nothing and see to it that something happens on the way."""

    def __init__(self, monkeypatch, *acts):
        self.acts, self.seen = list(acts), 0
        monkeypatch.setattr(module, "simulate_scene", self)

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
    batch = np.zeros(1, TASK)
    batch["string"], batch["first"], batch["count"] = 3, 5, count
    batch["frames"], batch["parameters"] = frames, campaign.parameters()
    return batch


def done(simulator, batch):
    job, taken = simulator.begin(batch[0]), Batch([], [], [], [])
    while job.go_on():
        pass
    job.take(taken)
    return taken


def too_long(watch):
    """Take too long, under the eyes of the other thread."""

    def act():
        while not watch.abort[0]:
            time.sleep(0.001)
            watch.look()

    return act


def test_a_sample_that_takes_too_long_fails_and_the_next_one_runs(campaign, simulator, monkeypatch):
    Scenes(monkeypatch, None, too_long(simulator.watch))
    batch = done(simulator, task(campaign, 3))
    [rows], [failure] = batch.results, batch.failures
    assert rows["sample"].tolist() == [5, 6, 7]
    assert rows["state"].tolist() == [COMPLETED, FAILED, COMPLETED]
    assert rows["reason"].tolist() == [0, TIMED_OUT, 0]
    assert rows["particles"].tolist() == [50, 0, 50]
    assert rows["seconds"][1] > LONG
    assert (failure["string"], failure["sample"], failure["rank"]) == (3, 6, 2)
    assert failure["text"].item().decode() == f"{TOOK_TOO_LONG} {LONG} s"
    assert not simulator.watch.abort[0]
    assert final_results(rows)["sample"].tolist() == [5, 7], "it may be tried again"


def test_a_sample_that_takes_too_long_fails_though_nobody_looked(campaign, simulator, monkeypatch):
    Scenes(monkeypatch, lambda: time.sleep(2 * LONG))
    [rows] = done(simulator, task(campaign, 2)).results
    assert rows["reason"].tolist() == [TIMED_OUT, 0]


def test_a_look_that_was_meant_for_the_sample_before_repeats_the_sample(
    campaign, simulator, monkeypatch
):
    [wanted] = done(simulator, task(campaign, 2)).results
    undisturbed = Scenes(monkeypatch)
    [wanted] = done(simulator, task(campaign, 2)).results
    late = Scenes(monkeypatch, lambda: simulator.watch.abort.fill(1))
    batch = done(simulator, task(campaign, 2))
    [rows] = batch.results
    assert (undisturbed.seen, late.seen) == (2, 3)
    for name in OUTCOME.names:
        assert rows[name].tobytes() == wanted[name].tobytes()
    assert batch.failures == []


def test_an_exception_is_told_once_though_its_sample_is_repeated(campaign, simulator, monkeypatch):
    def fail_late():
        simulator.watch.abort[0] = 1
        fail()

    def fail():
        raise ArithmeticError("grains on strike")

    Scenes(monkeypatch, fail_late, fail)
    batch = done(simulator, task(campaign, 2))
    [rows], [failure] = batch.results, batch.failures
    assert rows["reason"].tolist() == [EXCEPTION, 0]
    assert failure["sample"] == 5


def test_time_between_samples_does_not_count(campaign, simulator, monkeypatch):
    scenes = Scenes(monkeypatch)
    job = simulator.begin(task(campaign, 2)[0])
    assert job.go_on()
    time.sleep(2 * LONG)
    simulator.watch.look()
    assert not simulator.watch.abort[0]
    assert not job.go_on()
    assert scenes.seen == 2


def test_a_stop_wins_over_a_look(campaign, simulator, monkeypatch):
    watch = simulator.watch

    def both():
        too_long(watch)()
        watch.stop()

    scenes = Scenes(monkeypatch, None, both)
    batch = done(simulator, task(campaign, 3))
    [rows] = batch.results
    assert rows["sample"].tolist() == [5], "what is stopped never was"
    assert batch.failures == []
    assert watch.abort[0]
    assert scenes.seen == 2


def test_a_stop_between_samples_is_not_forgotten():
    watch = Watch(1.0)
    watch.begin()
    watch.stop()
    assert watch.end() == (False, True)
    assert watch.abort[0]
    watch.begin()
    assert watch.end() == (False, True)


def test_what_is_given_up_is_no_result_and_has_no_particles(tmp_path, monkeypatch):
    path = write_campaign(tmp_path / "kept.yaml", **SMALL)
    path.write_text(f"{path.read_text()}\noutput: {{final_particles: true}}\n")
    campaign = load_campaign(path)
    simulator = Simulator(CampaignWork(campaign), 2)
    job, batch = simulator.begin(task(campaign, 3)[0]), Batch([], [], [], [])
    assert job.go_on()
    job.give_up()
    job.take(batch)
    [rows], [final] = batch.results, batch.finals
    assert rows["sample"].tolist() == [5, 6, 7]
    assert rows["reason"].tolist() == [0, NOT_NEEDED, NOT_NEEDED]
    assert rows["objective"][1:].tolist() == [0.0, 0.0]
    assert final["sample"].tolist() == [5]
    assert final_results(rows)["sample"].tolist() == [5]
    assert batch.failures == []


def test_a_hurried_sample_is_done_again(campaign, simulator, monkeypatch):
    scenes = Scenes(monkeypatch, simulator.watch.hurry)
    [rows] = done(simulator, task(campaign, 2)).results
    assert rows["reason"].tolist() == [0, 0]
    assert scenes.seen == 3


def test_without_a_limit_nothing_takes_too_long():
    watch = Watch(None)
    watch.begin()
    watch.look()
    assert watch.end() == (False, False)


def test_pictures_are_whole_however_long_ago_the_last_sample_was(campaign, simulator, monkeypatch):
    Scenes(monkeypatch)
    done(simulator, task(campaign, 1))
    time.sleep(2 * LONG)
    simulator.watch.look()
    for act in (None, lambda: simulator.watch.abort.fill(1)):
        scenes = Scenes(monkeypatch, act)
        [rows] = done(simulator, task(campaign, 1, frames=3)).frames
        assert rows["particles"].tolist() == [50] * 3
        assert scenes.seen == (1 if act is None else 2)


def test_pictures_of_a_sample_that_takes_too_long_are_given_up(campaign, simulator, monkeypatch):
    Scenes(monkeypatch, too_long(simulator.watch))
    batch = done(simulator, task(campaign, 2, frames=3))
    [rows], [failure] = batch.frames, batch.failures
    assert rows["sample"].tolist() == [6] * 3
    assert failure["sample"] == 5
    assert failure["text"].item().decode().startswith(TOOK_TOO_LONG)


def test_the_thread_looks_while_it_is_asked_for_results(tmp_path):
    path = write_campaign(tmp_path / "endless.yaml", **SMALL)
    endless = "end_time: 1e9 s\n  engine: {law: event, budget: 1000000000}"
    text = path.read_text().replace("end_time: characteristic", endless)
    path.write_text(f"{text.rstrip()}\n  max_seconds: 0.2 s\n")
    campaign = load_campaign(path)
    simulator = Simulator(CampaignWork(campaign), 0)
    simulator.warm_up()
    batch = task(campaign, 2)
    batch["parameters"] = campaign.parameters({"hardness": 1e30})  # so hard that nothing bonds
    thread = SimulatorThread(simulator, Bell())
    thread.put(batch)
    rows, end = [], time.monotonic() + 20.0
    while len(rows) < 2:
        assert time.monotonic() < end
        time.sleep(0.01)
        taken = thread.take()
        rows += taken.results if taken is not None else []
    thread.stop()
    rows = np.concatenate(rows)
    assert rows["sample"].tolist() == [5, 6]
    assert rows["reason"].tolist() == [TIMED_OUT] * 2
    assert np.all(rows["seconds"] > 0.2)
