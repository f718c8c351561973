import os

import h5py
import numpy as np
import pytest
from storage_rows import (
    MAX_SAMPLES,
    STRINGS,
    begin_leg,
    put_generation,
    put_result,
    put_strings,
    sample_rows,
    table_room,
)

from agglom_mpi.storage import create
from agglom_mpi.storage.create import enlarge_campaign_file
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.writer import CampaignWriter


@pytest.fixture
def filled(path):
    with CampaignWriter(path) as writer:
        begin_leg(writer)
        writer.set_status("finished", "all done")
        put_strings(writer, 0, STRINGS)
        for string in range(STRINGS):
            writer.put_samples(sample_rows(string, string, 7))
        put_result(writer, 3, 0.5)
        put_generation(writer, 1)
        writer.log.put_failure(1, 2, rank=3, host="b", text="broken")
    return path


def everything(path):
    campaign = read_campaign(path)
    return [
        campaign.variable_rows(),
        campaign.string_rows(),
        campaign.result_rows(),
        campaign.generation_rows(),
        campaign.all_sample_rows(),
        campaign.legs(),
        campaign.failures(),
        campaign.status(),
        {k: v for k, v in campaign.attributes.items() if k not in ("strings", "checksums")},
    ]


def same(left, right):
    return all(
        a.tobytes() == b.tobytes() if isinstance(a, np.ndarray) else a == b
        for a, b in zip(left, right, strict=True)
    )


@pytest.mark.parametrize("block", [1 << 25, 400])
def test_growing_keeps_everything(filled, monkeypatch, block):
    monkeypatch.setattr(create, "_COPY_BYTES", block)
    os.chmod(filled, 0o640)
    before = everything(filled)
    with h5py.File(filled, "r+") as file:
        file["results_done"][7] = 1
    enlarge_campaign_file(filled, table_room(2 * STRINGS, 9))
    assert same(everything(filled), before)
    assert filled.stat().st_mode & 0o777 == 0o640
    assert os.listdir(filled.parent) == ["grains.h5"]
    campaign = read_campaign(filled)
    assert campaign.attributes["strings"] == 2 * STRINGS
    assert campaign.damaged == 1, "damage is not hidden"
    with CampaignWriter(filled) as writer:
        put_strings(writer, STRINGS, STRINGS)
        writer.put_samples(sample_rows(2 * STRINGS - 1, MAX_SAMPLES - 1, 1))
        put_generation(writer, 8)
    assert len(read_campaign(filled).all_sample_rows()) == 7 * STRINGS + 1


@pytest.mark.parametrize("block", [1 << 25, 400])
def test_room_for_fresh_samples_moves_rows_to_their_new_places(filled, monkeypatch, block):
    monkeypatch.setattr(create, "_COPY_BYTES", block)
    before = read_campaign(filled).all_sample_rows()
    assert enlarge_campaign_file(filled, table_room(STRINGS, 1, fresh=3))
    campaign = read_campaign(filled)
    assert campaign.all_sample_rows().tobytes() == before.tobytes()
    assert (campaign.fresh_from, campaign.max_samples) == (MAX_SAMPLES, MAX_SAMPLES + 3)
    assert campaign.damaged == 0
    with h5py.File(filled) as file:
        places = np.flatnonzero(file["samples_done"][:])
    assert places.tolist() == sorted(before["string"] * (MAX_SAMPLES + 3) + before["sample"]), (
        "row = string * max_samples + sample"
    )
    with CampaignWriter(filled) as writer:
        writer.put_samples(sample_rows(STRINGS - 1, MAX_SAMPLES + 2, 1))
    campaign.refresh()
    assert len(campaign.all_sample_rows()) == len(before) + 1
    assert not enlarge_campaign_file(filled, table_room(STRINGS, 1, fresh=2))


def test_enough_room_is_left_alone(filled):
    before = filled.stat()
    enlarge_campaign_file(filled, table_room(STRINGS, 1))
    after = filled.stat()
    assert (before.st_ino, before.st_mtime_ns) == (after.st_ino, after.st_mtime_ns)


def test_only_what_is_short_grows(filled):
    enlarge_campaign_file(filled, table_room(1, 50))
    with h5py.File(filled, "r") as file:
        assert (len(file["generations"]), len(file["strings"])) == (50, STRINGS)


def test_a_failed_growth_leaves_the_old_file(filled, file_size_limit):
    before = filled.read_bytes()
    file_size_limit(filled.stat().st_size)
    with pytest.raises(OSError, match=r"too large.*grains\.h5"):
        enlarge_campaign_file(filled, table_room(10 * STRINGS, 1))
    assert filled.read_bytes() == before
    assert os.listdir(filled.parent) == ["grains.h5"]
