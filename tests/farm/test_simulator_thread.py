import signal
import threading
import time
from collections import deque

import numpy as np
import pytest
from farm_runs import SMALL, write_campaign

from agglom_mpi.campaign import load_campaign
from agglom_mpi.farm import simulator as module
from agglom_mpi.farm.bell import Bell
from agglom_mpi.farm.messages import (
    FAILED_SAMPLE,
    NOT_NEEDED,
    RESULT,
    TASK,
    failed_sample,
    final_results,
)
from agglom_mpi.farm.simulator import Batch, Simulator, Watch
from agglom_mpi.farm.thread import HELD_BACK, SimulatorThread
from agglom_mpi.farm.work import CampaignWork
from agglom_mpi.simulation.outcome import COLUMNS, COMPLETED, EXCEPTION, FAILED


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    return load_campaign(write_campaign(folder / "small.yaml", **SMALL))


def tasks(campaign, count=1, string=3):
    """Return one task of so many samples, in a batch of its own."""
    batch = np.zeros(1, TASK)
    batch["string"], batch["count"] = string, count
    batch["parameters"] = campaign.parameters()
    return batch


class Fake:
    """A simulator that computes nothing, with a say in what goes wrong."""

    def __init__(self, act=lambda fake, sample: None):
        self.watch = Watch(None)
        self.seen = []
        self._act = act

    def begin(self, task):
        return FakeJob(self, task)

    def simulate(self, sample):
        self.seen.append(sample)
        self._act(self, sample)


class FakeJob:
    """Samples of a task that are nothing but their numbers."""

    def __init__(self, fake, task):
        self._fake = fake
        self._left = deque(range(int(task["first"]), int(task["first"] + task["count"])))
        self._done = []
        self._string = int(task["string"])

    def go_on(self):
        self._fake.watch.begin()
        self._fake.simulate(self._left[0])
        _, hurried = self._fake.watch.end()
        if self._fake.watch.stopped:
            return False
        if hurried:
            return True
        self._done.append((self._left.popleft(), 0))
        return bool(self._left)

    def give_up(self):
        self._done += [(sample, NOT_NEEDED) for sample in self._left]

    def take(self, batch):
        results = np.zeros(len(self._done), RESULT)
        results["string"] = self._string
        for row, done in zip(results, self._done, strict=True):
            row["sample"], row["reason"] = done
        self._done = []
        if len(results):
            batch.results.append(results)


def some(count, first=0, string=0):
    """Return a batch of one task for a fake."""
    batch = np.zeros(1, TASK)
    batch["string"], batch["first"], batch["count"] = string, first, count
    return batch


def done(simulator, task):
    """Return what comes of one task."""
    batch, job = Batch([], [], [], []), simulator.begin(task)
    while job.go_on():
        pass
    job.take(batch)
    return batch


def test_a_rank_computes_what_the_campaign_does_for_everybody(campaign):
    batch = done(Simulator(CampaignWork(campaign), 2), tasks(campaign)[0])
    outcome = campaign.simulate(campaign.parameters(), 0)
    [result] = batch.results
    assert batch == ([result], [], [], [])
    assert result["state"] == COMPLETED
    for column in COLUMNS:
        assert result[column.name][0].tobytes() == outcome.record[column.name].tobytes()
    assert result["objective"] == outcome.objective
    assert (result["string"], result["sample"], result["rank"]) == (3, 0, 2)


def taken(thread, seconds):
    """Next batch, if it is finished within so many seconds."""
    end = time.monotonic() + seconds
    while (batch := thread.take()) is None and time.monotonic() < end:
        time.sleep(1e-3)
    return batch


def test_an_exception_in_a_sample_is_a_failed_row_with_its_text(campaign, monkeypatch):
    def raise_at_once(*arguments):
        raise ArithmeticError("grains on strike")

    monkeypatch.setattr(module, "simulate_scene", raise_at_once)
    thread = SimulatorThread(Simulator(CampaignWork(campaign), 2), Bell())
    thread.put(tasks(campaign, 2))
    batch = taken(thread, 20.0)
    thread.stop()
    results, failures = np.concatenate(batch.results), batch.failures
    assert results["state"].tolist() == [FAILED] * 2
    assert results["reason"].tolist() == [EXCEPTION] * 2
    assert [failure["sample"].item() for failure in failures] == [0, 1]
    assert failures[0]["string"].item() == 3
    assert failures[0]["rank"].item() == 2
    assert failures[0]["text"].item().decode().endswith("ArithmeticError: grains on strike\n")


def test_an_exception_of_the_thread_itself_is_raised_where_results_are_taken():
    def refuse(fake, sample):
        raise MemoryError("no more")

    thread = SimulatorThread(Fake(refuse), Bell())
    thread.put(some(1))
    with pytest.raises(MemoryError, match="no more"):
        taken(thread, 20.0)
    thread.stop()


def test_batches_come_back_whole_and_in_order():
    thread = SimulatorThread(Fake(), Bell())
    for first in (0, 10):
        thread.put(some(3, first))
    numbers = [np.concatenate(taken(thread, 20.0).results)["sample"].tolist() for _ in range(2)]
    thread.stop()
    assert numbers == [[0, 1, 2], [10, 11, 12]]


def test_tasks_of_a_batch_come_back_together():
    thread = SimulatorThread(Fake(), Bell())
    thread.put(np.concatenate([some(2), some(1, 7), some(2, 4)]))
    assert np.concatenate(taken(thread, 20.0).results)["sample"].tolist() == [0, 1, 7, 4, 5]
    thread.stop()


def test_what_is_finished_does_not_wait_for_long_for_the_rest_of_its_batch():
    last = threading.Event()

    def slow_in_the_end(fake, sample):
        if sample == 1:
            time.sleep(1.5 * HELD_BACK)
        elif sample == 3:
            assert last.wait(20.0)

    thread = SimulatorThread(Fake(slow_in_the_end), Bell())
    thread.put(some(4))
    assert np.concatenate(taken(thread, 20.0).results)["sample"].tolist() == [0, 1]
    last.set()
    assert np.concatenate(taken(thread, 20.0).results)["sample"].tolist() == [2, 3]
    thread.stop()


def test_nothing_finished_is_none_after_the_wait():
    thread = SimulatorThread(Fake(), Bell())
    assert thread.take() is None
    assert taken(thread, 0.01) is None
    thread.stop()


def test_stopping_abandons_what_runs_and_what_is_queued():
    running = threading.Event()

    def until_aborted(fake, sample):
        running.set()
        while not fake.watch.abort[0]:
            time.sleep(0.001)

    fake = Fake(until_aborted)
    thread = SimulatorThread(fake, Bell())
    for _ in range(3):
        thread.put(some(5))
    assert running.wait(20.0)
    thread.stop()
    assert thread.take() is None
    assert len(fake.seen) <= 3


def test_stopping_does_not_wait_for_the_end_of_a_long_sample(tmp_path):
    path = write_campaign(tmp_path / "long.yaml", **SMALL | {"steps": 5_000_000})
    campaign = load_campaign(path)
    simulator = Simulator(CampaignWork(campaign), 0)
    simulator.warm_up()
    thread = SimulatorThread(simulator, Bell())
    thread.put(tasks(campaign))
    time.sleep(0.1)
    begin = time.monotonic()
    thread.stop()
    assert time.monotonic() - begin < 5.0
    assert thread.take() is None


def test_stopping_does_not_wait_for_the_last_of_a_billion_events(tmp_path):
    path = write_campaign(tmp_path / "endless.yaml", **SMALL)
    endless = "end_time: 1e9 s\n  engine: {law: event, budget: 1000000000}"
    path.write_text(path.read_text().replace("end_time: characteristic", endless))
    campaign = load_campaign(path)
    simulator = Simulator(CampaignWork(campaign), 0)
    simulator.warm_up()
    batch = tasks(campaign)
    batch["parameters"] = campaign.parameters({"hardness": 1e30})  # so hard that nothing bonds
    thread = SimulatorThread(simulator, Bell())
    thread.put(batch)
    assert taken(thread, 0.5) is None
    begin = time.monotonic()
    thread.stop()
    assert time.monotonic() - begin < 1.0
    assert thread.take() is None


class Gate:
    """Samples that run until they are ended or let through, and say when they begin."""

    def __init__(self):
        self.begun, self.through = threading.Event(), threading.Event()

    def __call__(self, fake, sample):
        self.begun.set()
        while not (fake.watch.abort[0] or self.through.is_set()):
            time.sleep(1e-3)


def told(batch):
    """Return strings, samples and reasons of a batch of results."""
    rows = np.concatenate(batch.results)
    return rows[["string", "sample", "reason"]].tolist()


def test_what_is_withdrawn_is_left_out_where_it_is_under_way_and_where_it_waits():
    gate = Gate()
    thread = SimulatorThread(Fake(gate), Bell())
    thread.put(np.concatenate([some(2, 0, 1), some(1, 0, 2)]))
    thread.put(np.concatenate([some(1, 1, 2), some(2, 2, 1)]))
    assert gate.begun.wait(20.0)
    thread.withdraw([1])
    thread.put(some(1, 4, 1))  # asked for after that, so that it is wanted
    gate.through.set()
    batches = [told(taken(thread, 20.0)) for _ in range(3)]
    thread.stop()
    assert batches == [
        [(1, 0, NOT_NEEDED), (1, 1, NOT_NEEDED), (2, 0, 0)],
        [(2, 1, 0), (1, 2, NOT_NEEDED), (1, 3, NOT_NEEDED)],
        [(1, 4, 0)],
    ]


def test_what_is_under_way_is_not_disturbed_by_what_is_withdrawn_of_others():
    gate = Gate()
    fake = Fake(gate)
    thread = SimulatorThread(fake, Bell())
    thread.put(some(2, 0, 1))
    thread.put(some(1, 0, 2))
    assert gate.begun.wait(20.0)
    thread.withdraw([2, 3])
    gate.through.set()
    assert told(taken(thread, 20.0)) == [(1, 0, 0), (1, 1, 0)]
    assert told(taken(thread, 20.0)) == [(2, 0, NOT_NEEDED)]
    thread.stop()
    assert fake.seen == [0, 1]


@pytest.mark.parametrize("withdrawn", [[2], [1, 2]])
def test_nothing_is_answered_after_what_a_stop_has_abandoned(withdrawn):
    for _ in range(20):
        gate = Gate()
        thread = SimulatorThread(Fake(gate), Bell())
        thread.put(some(1, 0, 1))
        thread.put(some(1, 0, 2))
        assert gate.begun.wait(20.0)
        thread.withdraw(withdrawn)
        thread.stop()
        answers = []
        while (batch := thread.take()) is not None:
            answers += told(batch)
        assert answers == [(1, 0, NOT_NEEDED), (2, 0, NOT_NEEDED)][: len(answers)]


def test_a_thread_does_not_remember_withdrawals_for_ever():
    thread = SimulatorThread(Fake(), Bell())
    for string in range(100):
        thread.put(some(1, 0, string))
        assert taken(thread, 20.0) is not None
        thread.withdraw([string])
    thread.stop()
    assert len(thread._withdrawn) <= 2


def test_withdrawals_at_any_moment_lose_no_sample_and_leave_out_no_other():
    chance = np.random.default_rng(3)
    thread = SimulatorThread(Fake(lambda fake, sample: time.sleep(1e-5)), Bell())
    wanted, found, withdrawn = [], [], set()
    for string in range(400):
        for size in (1, 2):
            thread.put(some(size, 0, string))
            wanted += [(string, sample) for sample in range(size)]
        time.sleep(5e-5 * chance.random())
        if chance.random() < 0.5:
            thread.withdraw([string])
            withdrawn.add(string)
    while len(found) < len(wanted):
        found += told(taken(thread, 20.0))
    thread.stop()
    assert [row[:2] for row in found] == wanted
    left_out = {string for string, _, reason in found if reason}
    assert len(left_out) > 20
    assert left_out <= withdrawn


def test_a_sample_of_a_billion_events_ends_when_it_is_withdrawn(tmp_path):
    path = write_campaign(tmp_path / "endless.yaml", **SMALL)
    endless = "end_time: 1e9 s\n  engine: {law: event, budget: 1000000000}"
    path.write_text(path.read_text().replace("end_time: characteristic", endless))
    campaign = load_campaign(path)
    simulator = Simulator(CampaignWork(campaign), 0)
    simulator.warm_up()
    batch = tasks(campaign, 2)
    batch["parameters"] = campaign.parameters({"hardness": 1e30})  # so hard that nothing bonds
    thread = SimulatorThread(simulator, Bell())
    thread.put(batch)
    assert taken(thread, 0.5) is None
    begin = time.monotonic()
    thread.withdraw([3])
    results = np.concatenate(taken(thread, 20.0).results)
    thread.stop()
    assert results[["sample", "reason"]].tolist() == [(0, NOT_NEEDED), (1, NOT_NEEDED)]
    assert results["seconds"][0] > results["seconds"][1] == 0.0
    assert time.monotonic() - begin < 5.0
    assert len(final_results(results)) == 0


def test_what_pictures_need_is_compiled_before_anything_runs(tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(module, "simulate_scene", lambda *arguments: seen.append(arguments[3:]))
    for name, output in (("bare", ""), ("kept", "output: {frames: {count: 3}}")):
        path = write_campaign(tmp_path / f"{name}.yaml", **SMALL)
        path.write_text(f"{path.read_text()}\n{output}\n")
        Simulator(CampaignWork(load_campaign(path)), 0).warm_up()
    assert [frames is not None for (frames,) in seen] == [False, False, True]


def test_pictures_of_a_sample_that_fails_end_there(tmp_path):
    path = write_campaign(tmp_path / "short.yaml", **SMALL)
    text = path.read_text().replace(
        "end_time: characteristic", "end_time: 1 s\n  engine: {law: event, budget: 1}"
    )
    path.write_text(f"{text}\noutput: {{frames: {{count: 3}}}}\n")
    task = tasks(load_campaign(path))
    task["frames"] = 3
    batch = done(Simulator(CampaignWork(load_campaign(path)), 0), task[0])
    [rows] = batch.frames
    assert batch == ([], [], [], [rows])
    assert rows["particles"].tolist() == [100, 0, 0]
    assert rows["frame"].tolist() == [0, 1, 2]
    assert np.isfinite(rows["position"][0]).all()
    assert np.isnan(rows["position"][1:]).all()


def test_of_a_long_traceback_the_end_travels():
    text = "ä" * 1000 + "\nValueError: the end"
    record = failed_sample(1, 2, 3, text)
    assert record.dtype == FAILED_SAMPLE
    stored = record["text"].item().decode()
    assert stored.endswith("\nValueError: the end")
    assert set(stored[: -len("\nValueError: the end")]) == {"ä"}


def test_an_interruption_at_the_wrong_moment_does_not_let_it_wait_for_ever():
    """Here timer signals take it away from its wait, on a busy machine other processes do."""
    bell, end = Bell(), time.monotonic() + 60.0
    thread = SimulatorThread(Fake(), bell)

    def interrupt(number, frame):
        assert time.monotonic() < end, "waits for ever"

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 1e-4, 1e-4)
    try:
        for _ in range(20_000):
            thread.put(some(1))
            while thread.take() is None:
                bell.wait(60.0)
            assert thread.take() is None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    thread.stop()
