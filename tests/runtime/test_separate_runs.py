"""Runs of one job by single ranks: exit codes, and a stop that rank 0 passes on."""

import pytest

from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.display.run_display import Display
from agglom_mpi.errors import BAD_INPUT, FAILURE, FINISHED, STOPPED
from agglom_mpi.runtime.separate_runs import SharedStop, _worst_of_all, run_separately, shared


@pytest.fixture(autouse=True)
def _handlers(monkeypatch):
    monkeypatch.setattr("agglom_mpi.runtime.stop_request.StopRequest.listen", lambda self: None)


def codes(*given, max_walltime=None):
    """Return the exit code of runs that end with these codes, and which of them were begun."""
    begun = []

    def run(request, stop):
        begun.append(request)
        return given[request]

    return run_separately(range(len(given)), run, None, max_walltime), begun


def test_all_runs_are_done_one_after_the_other():
    assert codes(FINISHED, FINISHED, FINISHED) == (FINISHED, [0, 1, 2])


@pytest.mark.parametrize("code", [STOPPED, FAILURE, BAD_INPUT])
def test_a_run_that_does_not_finish_ends_the_others(code):
    assert codes(FINISHED, code, FINISHED) == (code, [0, 1])


def test_no_run_is_begun_after_the_walltime():
    assert codes(FINISHED, max_walltime=1e-9) == (STOPPED, [])


def test_the_mistakes_of_a_user_are_a_message_and_an_exit_code(capsys):
    def read():
        raise CampaignError(Problem("study.yaml", 3, "seeds", "is 1"))

    assert shared(read, Display(), None) == (BAD_INPUT, None)
    assert "study.yaml:3: seeds: is 1" in capsys.readouterr().err
    assert shared(lambda: 7, Display(), None) == (FINISHED, 7)


class Sent:
    """A message that has arrived, or not yet."""

    def __init__(self, arrived=True):
        self.arrived = arrived

    def Test(self):  # noqa: N802
        return self.arrived


class World:
    """Ranks of which one is here; what it sends is kept."""

    def __init__(self, rank, size=3):
        self.rank, self.size, self.sent = rank, size, []
        self.pending = Sent(arrived=False)

    def Isend(self, word, dest, tag):  # noqa: N802
        self.sent.append((dest, int(word[0])))
        return Sent()

    def Irecv(self, word, source, tag):  # noqa: N802
        self.word = word
        return self.pending


def test_rank_0_passes_a_stop_on_once():
    world = World(0)
    stop = SharedStop(None, world)
    assert stop.reason == ""
    assert world.sent == []
    stop.request("a test")
    assert stop.reason == stop.reason == "a test"
    stop.tell(stops=False)
    assert world.sent == [(1, 1), (2, 1)]


def test_another_rank_stops_when_rank_0_has_a_reason():
    world = World(1)
    stop = SharedStop(None, world)
    assert stop.reason == ""
    world.word[0], world.pending.arrived = 1, True
    assert stop.reason


def test_another_rank_goes_on_when_rank_0_has_none():
    world = World(1)
    stop = SharedStop(None, world)
    world.word[0], world.pending.arrived = 0, True
    assert stop.reason == ""
    assert world.sent == []


@pytest.mark.parametrize(
    ("ended", "worst"),
    [
        ((FINISHED, FINISHED, FINISHED), FINISHED),
        ((FINISHED, STOPPED, FINISHED), STOPPED),
        ((STOPPED, FINISHED, FAILURE), FAILURE),
        ((BAD_INPUT, STOPPED, FINISHED), BAD_INPUT),
    ],
)
def test_a_job_ends_as_its_worst_rank_does(ended, worst):
    class Ranks(World):
        def Irecv(self, word, source, tag):  # noqa: N802
            word[0] = ended[source]
            return Sent()

        def Ibcast(self, word, root):  # noqa: N802
            return Sent()

    world = Ranks(0)
    assert _worst_of_all(ended[0], SharedStop(None, world), world) == worst
