"""What ranks still send of the search when its strings are already looked at again."""

import numpy as np
from campaign_runs import TINY, finish
from particle_runs import pictures_wanted, write_bulk_campaign

from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.display.run_display import Display
from agglom_mpi.runtime.coordinator import Coordinator
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import prepare
from agglom_mpi.runtime.messages import RankMessage, failed_sample
from agglom_mpi.runtime.silence import GoneRanks
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.scheduling.estimators import ROUND_TRIP_SECONDS
from agglom_mpi.simulation.frames import new_frames
from agglom_mpi.storage.particle_tables import frame_rows
from agglom_mpi.storage.writer import CampaignWriter


class Pool:
    """One rank that first tells of an exception from the search, and then does its picture."""

    size, gone, deserted = 1, GoneRanks(), frozenset()
    round_trip = ROUND_TRIP_SECONDS

    def __init__(self, grains):
        self.grains, self.sent, self.hosts = grains, [], {}

    def send(self, rank, tasks):
        self.sent.append(tasks)

    def poll(self):
        [[task]] = self.sent
        pair = int(task["string"]), int(task["first"])
        yield RankMessage(0, failures=failed_sample(*pair, 0, "left over"))
        frames = new_frames(np.arange(float(task["frames"])), self.grains)
        yield RankMessage(0, frames=(frame_rows(*pair, frames),))


def test_a_sample_of_the_search_that_raises_late_gives_up_no_picture(tmp_path):
    path = tmp_path / "tiny.h5"
    write_bulk_campaign(tmp_path / "tiny.yaml", "", **TINY)
    finish(tmp_path, "tiny.yaml", "-q")
    write_bulk_campaign(tmp_path / "tiny.yaml", "frames: {count: 2, strings: 1}", **TINY)
    work = InversionExperiment(load_campaign(tmp_path / "tiny.yaml"))
    file = prepare(path, work, accept_code_change=False)
    with CampaignWriter(path) as writer:
        coordinator = Coordinator(work, file, writer, Display(quiet=True))
        assert not coordinator.replay(StopRequest())
        end = coordinator.run(Pool(100), StopRequest(None))
    assert (end.code, end.state) == (0, "finished")
    assert open_campaign(path).framed() == pictures_wanted(path, 1, 1)
