"""Tasks whose samples are one compiled call: what ends one of them leaves the others."""

import threading
import time
import zlib

import numpy as np
import pytest
from campaign_runs import SMALL, write_campaign
from processes import HANG

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import COMPLETED, OUTCOME, FailureReason
from agglom_mpi.runtime import simulated_strings
from agglom_mpi.runtime import task_runner as module
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.scheduling.interface import task_type
from agglom_mpi.storage.table import checksum_ok

COUNT = 200


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    path = write_campaign(tmp_path_factory.mktemp("campaign") / "small.yaml", **SMALL)
    path.write_text(f"{path.read_text().rstrip()}\n  max_seconds: 50 s\n")
    return load_campaign(path)


@pytest.fixture
def runner(campaign):
    runner = SampleRunner(InversionExperiment(campaign), 2)
    runner.warm_up()
    return runner


@pytest.fixture(scope="module")
def wanted(campaign):
    """Results of all samples, each by a call of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "MAX_AT_ONCE", 1)
        job = begun(SampleRunner(InversionExperiment(campaign), 2), campaign)
        while job.simulate_next():
            pass
        return job.collect().results


def begun(runner, campaign):
    batch = np.zeros(1, task_type(10))
    batch["string"], batch["first"], batch["count"] = 3, 5, COUNT
    batch["parameters"] = campaign.parameters()
    return runner.begin(batch[0])


def same(rows, wanted):
    return all(
        rows[name].tobytes() == wanted[name].tobytes() for name in (*OUTCOME.names, "sample")
    )


class Ranges:
    """Compiled calls, during the first of which another thread acts when 3 samples are finished."""

    def __init__(self, monkeypatch, act):
        self.calls, self._act, self._simulate = [], act, module.simulate_samples
        monkeypatch.setattr(module, "simulate_samples", self)

    def __call__(self, scene, words, first, watch, results):
        self.calls.append((first, len(results.records)))
        if len(self.calls) > 1:
            return self._simulate(scene, words, first, watch, results)

        def act():
            while results.finished[0] < 3:
                time.sleep(1e-5)
            self._act()

        thread = threading.Thread(target=act)
        thread.start()
        cut = self._simulate(scene, words, first, watch, results)
        thread.join(HANG)
        return cut


def test_a_task_is_one_call_and_its_rows_are_those_of_one_call_each(
    runner, campaign, wanted, monkeypatch
):
    ranges = Ranges(monkeypatch, lambda: None)
    job = begun(runner, campaign)
    assert not job.simulate_next()
    batch = job.collect()
    assert ranges.calls == [(5, COUNT)]
    assert same(batch.results, wanted)
    assert batch.results["objective"].tolist() == wanted["objective"].tolist()
    assert len(batch.failures) == 0


def test_rows_carry_the_checksum_of_what_is_sent(runner, campaign):
    job = begun(runner, campaign)
    job.simulate_next()
    rows = job.collect().results
    assert rows.dtype == runner.result_dtype
    assert checksum_ok(rows).all()
    blank = rows[:1].copy()
    blank["crc"] = 0
    assert rows["crc"][0] == zlib.crc32(blank.tobytes()) != 0
    assert blank["objective"][0] > 0.0


def test_an_interrupt_repeats_one_sample_of_a_range(runner, campaign, wanted, monkeypatch):
    ranges = Ranges(monkeypatch, runner.abort_flag.interrupt)
    job = begun(runner, campaign)
    while job.simulate_next():
        pass
    rows = job.collect().results
    assert len(ranges.calls) == 2
    first, count = ranges.calls[1]
    assert first >= 5 + 3
    assert first + count == 5 + COUNT
    assert same(rows, wanted)
    assert not runner.abort_flag.abort[0]


def test_a_stop_leaves_what_is_finished(runner, campaign, wanted, monkeypatch):
    Ranges(monkeypatch, runner.abort_flag.stop)
    job = begun(runner, campaign)
    assert not job.simulate_next()
    rows = job.collect().results
    assert 3 <= len(rows) < COUNT
    assert same(rows, wanted[: len(rows)])
    assert runner.abort_flag.abort[0]


def test_what_is_cancelled_in_a_range_is_left_out_from_there(runner, campaign, wanted, monkeypatch):
    Ranges(monkeypatch, runner.abort_flag.interrupt)
    job = begun(runner, campaign)
    assert job.simulate_next()
    job.cancel()
    message = job.collect()
    rows, [part] = message.results, message.parts
    assert 3 <= len(rows) < COUNT
    assert same(rows, wanted[: len(rows)])
    assert part[["string", "first", "size", "left_out"]].tolist() == (3, 5, len(rows), True)
    assert part["cpu_seconds"] > 0.0


def test_one_sample_of_a_range_takes_too_long(runner, campaign, wanted, monkeypatch):
    flag = runner.abort_flag

    def run_late():
        flag.max_seconds = 0.0
        flag.check_time()

    ranges = Ranges(monkeypatch, run_late)
    job = begun(runner, campaign)
    assert job.simulate_next()
    flag.max_seconds = 50.0
    while job.simulate_next():
        pass
    batch = job.collect()
    rows, [failure] = batch.results, batch.failures
    late = int(np.flatnonzero(rows["reason"])[0])
    assert rows["reason"][late] == FailureReason.TIMED_OUT
    assert failure["sample"] == 5 + late
    assert ranges.calls[1] == (5 + late + 1, COUNT - late - 1)
    others = np.arange(COUNT) != late
    assert same(rows[others], wanted[others])


def test_an_exception_in_a_range_is_one_sample_that_failed(runner, campaign, wanted, monkeypatch):
    simulate, calls = module.simulate_samples, []

    def fail_at_the_third(scene, words, first, watch, results):
        calls.append(first)
        if len(calls) > 1:
            return simulate(scene, words, first, watch, results)
        few = results._replace(records=results.records[:2])
        assert not simulate(scene, words, first, watch, few)
        raise ArithmeticError("grains on strike")

    monkeypatch.setattr(module, "simulate_samples", fail_at_the_third)
    job = begun(runner, campaign)
    while job.simulate_next():
        pass
    batch = job.collect()
    rows, [failure] = batch.results, batch.failures
    assert calls == [5, 8]
    assert failure["sample"] == 7
    assert rows["reason"].tolist() == [0, 0, FailureReason.EXCEPTION, *[0] * (COUNT - 3)]
    others = rows["state"] == COMPLETED
    assert same(rows[others], wanted[others])


def test_what_is_finished_is_handed_over_in_time(runner, campaign, wanted):
    """However little time there is, at least one sample is simulated."""
    job, counts = begun(runner, campaign), []
    while job.simulate_next(0.0):
        counts.append(len(job.collect().results))
    assert counts == [1] * (COUNT - 1)
    assert job.collect().results["sample"].tolist() == [5 + COUNT - 1]


def test_times_of_samples_add_up_to_that_of_the_thread(runner, campaign):
    job = begun(runner, campaign)
    before = time.thread_time()
    assert not job.simulate_next()
    spent = time.thread_time() - before
    rows = job.collect().results
    assert 0.9 * spent < rows["cpu_seconds"].sum() <= spent
    assert np.all(rows["cpu_seconds"] > 0.0)


def test_scenes_of_the_last_strings_are_kept_and_no_others(runner, campaign, monkeypatch):
    monkeypatch.setattr(simulated_strings, "MAX_KEPT", 2)
    string = campaign.parameters()
    first = runner.strings.of(0, string)
    assert runner.strings.of(0, string) is first
    assert runner.strings.of(0, 2.0 * string) is not first
    runner.strings.of(0, string)
    runner.strings.of(1, string)
    assert runner.strings.of(0, string) is first
    runner.strings.of(2, string)
    runner.strings.of(3, string)
    assert runner.strings.of(0, string) is not first
