"""Decisions that a resume makes again, and a request to stop meanwhile."""

from types import MappingProxyType

from campaign_runs import TINY, finish, write_campaign

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.display.run_display import Display
from agglom_mpi.runtime import recorder
from agglom_mpi.runtime.coordinator import Coordinator
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import prepare
from agglom_mpi.runtime.silence import GoneRanks
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.writer import CampaignWriter


class Pool:
    """One rank that must not be asked for anything."""

    size, gone, deserted = 1, GoneRanks(), frozenset()
    hosts = MappingProxyType({})

    def send(self, rank, tasks):
        raise AssertionError(tasks)


def test_a_stop_ends_decisions_made_again_after_a_generation(tmp_path, monkeypatch):
    path = tmp_path / "tiny.h5"
    write_campaign(tmp_path / "tiny.yaml", **TINY | {"generations": 3})
    finish(tmp_path, "tiny.yaml", "-q")
    before = read_campaign(path).generation_rows()
    assert len(before) > 1
    monkeypatch.setattr(recorder, "NOTICE_AFTER", -1.0)
    work, lines = InversionExperiment(load_campaign(tmp_path / "tiny.yaml")), []
    file = prepare(path, work, accept_code_change=False)
    display = Display(quiet=True)
    monkeypatch.setattr(display, "message", lines.append)
    with CampaignWriter(path) as writer:
        stopped = Coordinator(work, file, writer, display)
        assert not stopped.replay(StopRequest(0.0))
        assert stopped.inversion.generation == 0
        assert stopped.run(Pool(), StopRequest(0.0)).state == "stopped"
        assert lines == []
        whole = Coordinator(work, file, writer, display)
        assert whole.replay(StopRequest())
        assert len(lines) == 1
    assert read_campaign(path).generation_rows().tobytes() == before.tobytes()
