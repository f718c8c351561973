import pytest
from storage_rows import sample_rows

from agglom_mpi.runtime.recorder import RunRecorder
from agglom_mpi.search.ensemble import EnsembleResult
from agglom_mpi.search.proposals import StringEvaluated
from agglom_mpi.storage.reader import read_campaign

RESULT = EnsembleResult(0.1, 0.01, 1.9, 10, 0, False, 6.859, 7.0)
STRING = 10**6
"""A string that no file of the tests has."""


class Writer:
    """Notes what it is given."""

    def __init__(self):
        self.calls = []

    def __getattr__(self, name):
        return lambda *arguments: self.calls.append(name)


@pytest.fixture
def writer():
    return Writer()


@pytest.fixture
def recorder(finished, writer):
    return RunRecorder(writer, read_campaign(finished), None, top=2, generations=3)


def test_a_result_is_stored_when_the_rank_that_simulated_it_has_written_its_samples(
    recorder, writer
):
    recorder.store_samples(sample_rows(STRING, 0, 10), writer=1)
    recorder.record([StringEvaluated(STRING, RESULT)])
    recorder.barrier.written(1, 9)
    assert "put_result" not in writer.calls
    recorder.barrier.written(1, 1)
    assert writer.calls == ["mark_running", "put_result"]


def test_samples_of_a_silent_rank_are_stored_before_the_results_that_rest_on_them(recorder, writer):
    recorder.store_samples(sample_rows(STRING, 0, 10), writer=1)
    recorder.record([StringEvaluated(STRING, RESULT)])
    recorder.take_over(1)
    assert writer.calls == ["mark_running", "put_samples", "flush", "put_result"]


def test_samples_that_no_rank_writes_are_stored_at_once(recorder, writer):
    recorder.store_samples(sample_rows(STRING, 0, 10))
    recorder.record([StringEvaluated(STRING, RESULT)])
    assert writer.calls == ["put_samples", "mark_running", "put_result"]
