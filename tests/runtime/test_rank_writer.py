"""A rank that writes its samples itself reports so before, as a file system may stall."""

import numpy as np
import pytest
from campaign_runs import TINY, write_campaign

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import prepare
from agglom_mpi.runtime.messages import RESULT
from agglom_mpi.storage import row_buffer
from agglom_mpi.storage.access import open_file
from agglom_mpi.storage.row_buffer import RankWriter


@pytest.fixture
def path(tmp_path, monkeypatch):
    """Return a file that one process opens where ranks would open it together."""

    def alone(path, *, world, **options):
        return open_file(path, **options)

    monkeypatch.setattr(row_buffer, "open_file", alone)
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    experiment = InversionExperiment(load_campaign(tmp_path / "tiny.yaml"))
    prepare(tmp_path / "tiny.h5", experiment, accept_code_change=False)
    return tmp_path / "tiny.h5"


@pytest.mark.parametrize("syncs", [True, False])
def test_a_rank_reports_before_it_writes_and_before_it_waits_for_the_disc(path, syncs):
    writer, reported = RankWriter(path, None, syncs=syncs), []
    writer.before_write = lambda: reported.append(writer.samples.written)
    writer.samples.put(np.zeros(3, RESULT))
    writer.samples.flush()
    assert reported == [0]
    writer.sync()
    assert reported == [0, 3][: 1 + syncs]
    writer.before_write = lambda: None
    writer.close()
