"""What was never written of a file is not read."""

import os

import h5py
import numpy as np
import pytest
from storage_rows import make, put_strings, sample_rows, table_room

from agglom_mpi.storage import rows
from agglom_mpi.storage.access import open_file
from agglom_mpi.storage.compact import write_compact
from agglom_mpi.storage.create import enlarge_campaign_file
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.verify import verify_rows
from agglom_mpi.storage.writer import CampaignWriter

ROOM = 10**6
"""Strings, which most of these files have no rows of."""


def knows_holes(folder):
    """Return whether the file system says where a file has holes."""
    with open(folder / "hole", "wb+") as file:
        file.truncate(1 << 24)
        try:
            return os.lseek(file.fileno(), 0, os.SEEK_DATA) > 0
        except OSError:
            return True  # nothing but a hole


@pytest.fixture
def large(tmp_path):
    """Return a file with room for 10^8 samples and rows of a few, far apart."""
    path = make(tmp_path / "large.h5", strings=ROOM, generations=10**6)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 3)
        writer.put_samples(sample_rows(1, 5, 9))
        put_strings(writer, ROOM - 2, 2)
        writer.put_samples(sample_rows(ROOM - 1, 98, 2))
    return path


@pytest.fixture
def read(monkeypatch):
    """Return a list of how many elements were read in each call."""
    counts, at_once = [], Rows.read_into

    def counted(self, first, rows):
        counts.append(len(rows))
        at_once(self, first, rows)

    monkeypatch.setattr(Rows, "read_into", counted)
    return counts


def final(path, name):
    with open_file(path) as file:
        return Rows(file[f"{name}_done"], path).nonzero().tolist()


SAMPLES = [*range(105, 114), ROOM * 100 - 2, ROOM * 100 - 1]


def test_final_rows_are_found_wherever_they_are(large, read):
    assert final(large, "strings") == [0, 1, 2, ROOM - 2, ROOM - 1]
    assert final(large, "samples") == SAMPLES
    assert not knows_holes(large.parent) or sum(read) < 1 << 16


@pytest.mark.parametrize("unknown", ["no descriptor", "no holes", "another driver"])
def test_without_knowledge_of_holes_everything_is_read(tmp_path, monkeypatch, unknown):
    monkeypatch.setattr(rows, "_BLOCK", 1000)
    monkeypatch.setattr(rows, "_SHORT", 100)
    path = make(tmp_path / "a.h5", strings=90)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 90)
        writer.put_samples(sample_rows(70, 98, 2))
    if unknown == "no descriptor":
        monkeypatch.setattr(os, "open", lambda *_: (_ for _ in ()).throw(OSError("no /proc")))
    elif unknown == "no holes":
        monkeypatch.setattr(os, "SEEK_DATA", 99)
    with h5py.File(path, driver="stdio" if unknown == "another driver" else None) as file:
        assert Rows(file["samples_done"], path).nonzero().tolist() == [7098, 7099]
        assert Rows(file["samples_done"], path).nonzero(7099, 900).tolist() == [7099]
        assert len(Rows(file["samples_done"], path).nonzero(0, 7098)) == 0


def test_the_name_may_belong_to_another_file_by_now(large, tmp_path):
    with open_file(large) as file:
        make(tmp_path / "other.h5").replace(large)
        assert Rows(file["samples_done"], large).nonzero().tolist() == SAMPLES


def test_verifying_reading_and_enlarging_follow_rows_not_room(tmp_path, read):
    if not knows_holes(tmp_path):
        pytest.skip("this file system does not say where holes are")
    path = make(tmp_path / "a.h5", strings=ROOM, generations=10**6)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 3)
        writer.put_samples(sample_rows(1, 5, 9))
    assert len(verify_rows(path).data.all_sample_rows()) == 9
    campaign = read_campaign(path)
    assert campaign.all_sample_rows()["sample"].tolist() == [*range(5, 14)]
    assert enlarge_campaign_file(path, table_room(ROOM + 1, 10**6))
    campaign.refresh()
    assert len(campaign.all_sample_rows()) == 9
    write_compact(path, tmp_path / "b.h5")
    assert sum(read) < 10**6


def test_rows_that_come_later_are_read_in_their_order(tmp_path):
    path = make(tmp_path / "a.h5")
    campaign = read_campaign(path)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 9)
        for string, first in ((4, 10), (2, 0), (4, 3)):
            writer.put_samples(sample_rows(string, first, 4))
            writer.flush()
            rows_now = (campaign.all_sample_rows(), campaign.refresh(), campaign.all_sample_rows())
            places = rows_now[-1]["string"] * 100 + rows_now[-1]["sample"]
            assert (np.diff(places) > 0).all()
    assert places.tolist() == [*range(200, 204), *range(403, 407), *range(410, 414)]
