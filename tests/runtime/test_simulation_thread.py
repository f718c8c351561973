import math
import signal
import threading
import time
from collections import deque
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from campaign_runs import HARD, SMALL, write_campaign, write_endless
from processes import HANG, wait_for
from returned_parts import parts_of

from agglom_mpi import stopwatch
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import COLUMNS, COMPLETED, FAILED, FailureReason
from agglom_mpi.runtime import simulation_thread as thread_module
from agglom_mpi.runtime import task_runner as module
from agglom_mpi.runtime.abort_flag import AbortFlag
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.messages import (
    FAILED_SAMPLE,
    RESULT,
    RankMessage,
    failed_sample,
)
from agglom_mpi.runtime.simulation_thread import MAX_DELAY, SimulationThread
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.runtime.wakeup import Wakeup
from agglom_mpi.scheduling.interface import task_type
from agglom_mpi.verbs.simulate import simulate


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    return load_campaign(write_campaign(folder / "small.yaml", **SMALL))


def tasks(campaign, count=1, string=3):
    """Return one task of so many samples, in a batch of its own."""
    batch = np.zeros(1, task_type(10))
    batch["string"], batch["count"] = string, count
    batch["parameters"] = campaign.parameters()
    return batch


class Fake:
    """A simulator that computes nothing, with a say in what goes wrong."""

    def __init__(self, act=lambda fake, sample: None):
        self.abort_flag, self.rank = AbortFlag(None), 0
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
        self._done, self._left_out = [], []
        self._string = int(task["string"])

    def simulate_next(self, seconds):
        self._fake.abort_flag.begin()
        self._fake.simulate(self._left[0])
        _, interrupted = self._fake.abort_flag.end()
        if self._fake.abort_flag.stopped:
            return False
        if interrupted:
            return True
        self._done.append(self._left.popleft())
        return bool(self._left)

    def cancel(self):
        self._left_out = [self._string]

    def collect(self):
        results = np.zeros(len(self._done), RESULT)
        results["string"], results["sample"] = self._string, self._done
        parts = parts_of(results, self._left_out)
        self._done, self._left_out = [], []
        return RankMessage(self._fake.rank, results, parts)


def some(count, first=0, string=0):
    """Return a batch of one task for a fake."""
    batch = np.zeros(1, task_type(10))
    batch["string"], batch["first"], batch["count"] = string, first, count
    return batch


def done(simulator, task):
    """Return what comes of one task."""
    job = simulator.begin(task)
    while job.simulate_next():
        pass
    return job.collect()


def test_a_rank_computes_what_the_campaign_does_for_everybody(campaign):
    batch = done(SampleRunner(InversionExperiment(campaign), 2), tasks(campaign)[0])
    outcome = simulate(campaign, campaign.parameters(), 0)
    [result] = batch.results
    assert (len(batch.failures), batch.final_particles, batch.frames) == (0, None, ())
    assert result["state"] == COMPLETED
    for column in COLUMNS:
        assert result[column.name].tobytes() == outcome.record[column.name].tobytes()
    assert result["objective"] == outcome.objective
    assert (result["string"], result["sample"], result["rank"]) == (3, 0, 2)


@pytest.fixture(autouse=True)
def _batches_come_back_whole(monkeypatch):
    """However long the machine lets a thread wait."""
    monkeypatch.setattr(thread_module, "MAX_DELAY", math.inf)


def taken(thread):
    """Wait for the next batch."""
    return wait_for(thread.poll, "a batch")


def wait_until_it_computes(thread):
    """Wait until the thread has been busy for a tenth of a second, with nothing but a sample."""

    def spent():
        number = thread._thread.native_id
        [own] = [one for one in psutil.Process().threads() if one.id == number]
        return own.user_time + own.system_time

    before = spent()
    wait_for(lambda: spent() > before + 0.1, "a busy thread")
    assert thread.poll() is None


def test_an_exception_in_a_sample_is_a_failed_row_with_its_text(campaign, monkeypatch):
    def raise_at_once(*arguments):
        raise ArithmeticError("grains on strike")

    monkeypatch.setattr(module, "simulate_samples", raise_at_once)
    thread = SimulationThread(SampleRunner(InversionExperiment(campaign), 2), Wakeup())
    thread.put(tasks(campaign, 2))
    batch = taken(thread)
    thread.stop()
    results, failures = batch.results, batch.failures
    assert results["state"].tolist() == [FAILED] * 2
    assert results["reason"].tolist() == [FailureReason.EXCEPTION] * 2
    assert [failure["sample"].item() for failure in failures] == [0, 1]
    assert failures[0]["string"].item() == 3
    assert failures[0]["rank"].item() == 2
    assert failures[0]["text"].item().decode().endswith("ArithmeticError: grains on strike\n")


def test_an_exception_of_the_thread_itself_is_raised_where_results_are_taken():
    def refuse(fake, sample):
        raise MemoryError("no more")

    thread = SimulationThread(Fake(refuse), Wakeup())
    thread.put(some(1))
    with pytest.raises(MemoryError, match="no more"):
        taken(thread)
    thread.stop()


def test_batches_come_back_whole_and_in_order():
    thread = SimulationThread(Fake(), Wakeup())
    for first in (0, 10):
        thread.put(some(3, first))
    numbers = [taken(thread).results["sample"].tolist() for _ in range(2)]
    thread.stop()
    assert numbers == [[0, 1, 2], [10, 11, 12]]


def test_tasks_of_a_batch_come_back_together():
    thread = SimulationThread(Fake(), Wakeup())
    thread.put(np.concatenate([some(2), some(1, 7), some(2, 4)]))
    assert taken(thread).results["sample"].tolist() == [0, 1, 7, 4, 5]
    thread.stop()


def test_what_is_finished_does_not_wait_for_long_for_the_rest_of_its_batch(monkeypatch):
    last, clock = threading.Event(), SimpleNamespace(now=0.0)
    clock.monotonic = lambda: clock.now
    monkeypatch.setattr(thread_module, "time", clock)
    monkeypatch.setattr(thread_module, "MAX_DELAY", MAX_DELAY)

    def slow_in_the_end(fake, sample):
        clock.now += 0.9 * MAX_DELAY
        if sample == 3:
            assert last.wait(HANG)

    thread = SimulationThread(Fake(slow_in_the_end), Wakeup())
    thread.put(some(4))
    assert taken(thread).results["sample"].tolist() == [0, 1]
    last.set()
    assert taken(thread).results["sample"].tolist() == [2, 3]
    thread.stop()


def test_nothing_finished_is_none():
    thread = SimulationThread(Fake(), Wakeup())
    assert thread.poll() is None
    thread.stop()


def test_stopping_abandons_what_runs_and_what_is_queued():
    running = threading.Event()

    def until_aborted(fake, sample):
        running.set()
        while not fake.abort_flag.abort[0]:
            time.sleep(0.001)

    fake = Fake(until_aborted)
    thread = SimulationThread(fake, Wakeup())
    for _ in range(3):
        thread.put(some(5))
    assert running.wait(HANG)
    thread.stop()
    assert thread.poll() is None
    assert len(fake.seen) <= 3


@pytest.mark.slow
def test_stopping_does_not_wait_for_the_last_of_a_billion_steps(tmp_path):
    path = write_campaign(tmp_path / "long.yaml", **SMALL | {"steps": 1_000_000_000})
    campaign = load_campaign(path)
    simulator = SampleRunner(InversionExperiment(campaign), 0)
    simulator.warm_up()
    thread = SimulationThread(simulator, Wakeup())
    thread.put(tasks(campaign))
    wait_until_it_computes(thread)
    thread.stop()
    assert thread.poll() is None


def test_stopping_does_not_wait_for_the_last_of_a_billion_events(tmp_path):
    campaign = load_campaign(write_endless(tmp_path / "endless.yaml"))
    simulator = SampleRunner(InversionExperiment(campaign), 0)
    simulator.warm_up()
    batch = tasks(campaign)
    batch["parameters"] = campaign.parameters(HARD)
    thread = SimulationThread(simulator, Wakeup())
    thread.put(batch)
    wait_until_it_computes(thread)
    thread.stop()
    assert thread.poll() is None


class Gate:
    """Samples that run until they are ended or let through, and say when they begin."""

    def __init__(self):
        self.begun, self.through = threading.Event(), threading.Event()

    def __call__(self, fake, sample):
        self.begun.set()
        while not (fake.abort_flag.abort[0] or self.through.is_set()):
            time.sleep(1e-3)


LEFT_OUT = "left out"


def told(batch):
    """Return strings and samples of a batch, with `LEFT_OUT` after those of a cancelled task."""
    found = []
    for part in batch.parts:
        string, first, size = (int(part[name]) for name in ("string", "first", "size"))
        found += [(string, sample) for sample in range(first, first + size)]
        found += [(string, LEFT_OUT)] * bool(part["left_out"])
    assert [pair for pair in found if pair[1] != LEFT_OUT] == batch.results[
        ["string", "sample"]
    ].tolist()
    return found


def test_what_is_cancelled_is_left_out_where_it_is_under_way_and_where_it_waits():
    gate = Gate()
    thread = SimulationThread(Fake(gate), Wakeup())
    thread.put(np.concatenate([some(2, 0, 1), some(1, 0, 2)]))
    thread.put(np.concatenate([some(1, 1, 2), some(2, 2, 1)]))
    assert gate.begun.wait(HANG)
    thread.cancel([1])
    thread.put(some(1, 4, 1))  # asked for after that, so that it is wanted
    gate.through.set()
    batches = [told(taken(thread)) for _ in range(3)]
    thread.stop()
    assert batches == [
        [(1, LEFT_OUT), (2, 0)],
        [(2, 1), (1, LEFT_OUT)],
        [(1, 4)],
    ]


def test_what_is_under_way_is_not_disturbed_by_what_is_cancelled_of_others():
    gate = Gate()
    fake = Fake(gate)
    thread = SimulationThread(fake, Wakeup())
    thread.put(some(2, 0, 1))
    thread.put(some(1, 0, 2))
    assert gate.begun.wait(HANG)
    thread.cancel([2, 3])
    gate.through.set()
    assert told(taken(thread)) == [(1, 0), (1, 1)]
    assert told(taken(thread)) == [(2, LEFT_OUT)]
    thread.stop()
    assert fake.seen == [0, 1]


@pytest.mark.parametrize("cancelled", [[2], [1, 2]])
def test_nothing_is_answered_after_what_a_stop_has_abandoned(cancelled):
    for _ in range(20):
        gate = Gate()
        thread = SimulationThread(Fake(gate), Wakeup())
        thread.put(some(1, 0, 1))
        thread.put(some(1, 0, 2))
        assert gate.begun.wait(HANG)
        thread.cancel(cancelled)
        thread.stop()
        answers = []
        while (batch := thread.poll()) is not None:
            answers += told(batch)
        assert answers == [(1, LEFT_OUT), (2, LEFT_OUT)][: len(answers)]


def test_a_thread_does_not_remember_cancellations_for_ever():
    thread = SimulationThread(Fake(), Wakeup())
    for string in range(20):
        thread.put(some(1, 0, string))
        assert taken(thread) is not None
        thread.cancel([string])
    thread.stop()
    assert len(thread.cancelled) <= 2


def test_cancellations_at_any_moment_lose_no_sample_and_leave_out_no_other():
    chance, through = np.random.default_rng(3), threading.Event()

    def short(fake, sample):
        assert through.wait(HANG)
        time.sleep(1e-5)

    thread = SimulationThread(Fake(short), Wakeup())
    wanted, cancelled, left_out = [], set(), set()
    for string in range(400):
        if string == 100:  # half of those before are cancelled before they begin
            through.set()
        for size in (1, 2):
            thread.put(some(size, 0, string))
            wanted.append([(string, sample) for sample in range(size)])
        time.sleep(5e-5 * chance.random())
        if chance.random() < 0.5:
            thread.cancel([string])
            cancelled.add(string)
    for whole in wanted:
        found = told(taken(thread))
        if found[-1][1] == LEFT_OUT:
            left_out.add(found.pop()[0])
            assert found == whole[: len(found)] != whole
        else:
            assert found == whole
    thread.stop()
    assert len(left_out) > 20
    assert left_out <= cancelled


def test_a_sample_of_a_billion_events_ends_when_it_is_cancelled(tmp_path):
    campaign = load_campaign(write_endless(tmp_path / "endless.yaml"))
    simulator = SampleRunner(InversionExperiment(campaign), 0)
    simulator.warm_up()
    batch = tasks(campaign, 2)
    batch["parameters"] = campaign.parameters(HARD)
    thread = SimulationThread(simulator, Wakeup())
    thread.put(batch)
    wait_until_it_computes(thread)
    thread.cancel([3])
    message = taken(thread)
    thread.stop()
    assert told(message) == [(3, LEFT_OUT)]
    assert len(message.results) == 0
    assert message.parts["cpu_seconds"] > 0.0


def test_what_pictures_need_is_compiled_before_anything_runs(tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(
        module, "compile_kernels", lambda scene, frames, *_, **__: seen.append(frames)
    )
    for name, output in (("bare", ""), ("kept", "output: {frames: {count: 3}}")):
        path = write_campaign(tmp_path / f"{name}.yaml", **SMALL)
        path.write_text(f"{path.read_text()}\n{output}\n")
        SampleRunner(InversionExperiment(load_campaign(path)), 0).warm_up()
    assert seen == [False, True]


def test_pictures_of_a_sample_that_fails_end_there(tmp_path):
    path = write_campaign(tmp_path / "short.yaml", **SMALL)
    text = path.read_text().replace(
        "end_time: characteristic", "end_time: 1 s\n  engine: {law: event, budget: 1}"
    )
    path.write_text(f"{text}\noutput: {{frames: {{count: 3}}}}\n")
    task = tasks(load_campaign(path))
    task["frames"] = 3
    batch = done(SampleRunner(InversionExperiment(load_campaign(path)), 0), task[0])
    [rows] = batch.frames
    assert (len(batch.results), len(batch.failures), batch.final_particles) == (0, 0, None)
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


@pytest.mark.parametrize("times", [2_000, pytest.param(20_000, marks=pytest.mark.slow)])
def test_an_interruption_at_the_wrong_moment_does_not_let_it_wait_for_ever(times):
    """Here timer signals take it away from its wait, on a busy machine other processes do."""
    wakeup = Wakeup()
    thread = SimulationThread(Fake(), wakeup)
    before = signal.signal(signal.SIGALRM, lambda number, frame: None)
    signal.setitimer(signal.ITIMER_REAL, 1e-4, 1e-4)
    try:
        for _ in range(times):
            thread.put(some(1))
            while thread.poll() is None:
                assert wakeup.wait(HANG), "nothing rang"
            assert thread.poll() is None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    thread.stop()


def test_the_thread_that_simulates_reads_its_own_processor_time(campaign, monkeypatch):
    readers, seconds = [], iter(range(10, 100, 10))

    def thread_time():
        readers.append(threading.current_thread())
        return float(next(seconds))

    clocks = SimpleNamespace(perf_counter=time.perf_counter, thread_time=thread_time)
    monkeypatch.setattr(stopwatch, "time", clocks)
    monkeypatch.setattr(module, "MAX_AT_ONCE", 1)  # else compiled code reads the clock
    simulator = SampleRunner(InversionExperiment(campaign), 0)
    simulator.warm_up()
    thread = SimulationThread(simulator, Wakeup())
    thread.put(tasks(campaign, 1))
    results = taken(thread).results
    thread.stop()
    assert set(readers) == {thread._thread}
    assert results["cpu_seconds"].sum() == pytest.approx(10.0)
