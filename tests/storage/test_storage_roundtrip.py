import time

import h5py
import numpy as np
import pytest
from storage_rows import (
    MAX_SAMPLES,
    POPULATION,
    STRINGS,
    begin_leg,
    put_generation,
    put_result,
    put_strings,
    sample_rows,
)

from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.storage import row_buffer
from agglom_mpi.storage.access import open_file
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.row_buffer import FLUSH_AGE
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.schema import (
    FAILURE_CAPACITY,
    LEG_CAPACITY,
    TOOK_TOO_LONG,
    sample_dtype,
)
from agglom_mpi.storage.table import checksums
from agglom_mpi.storage.writer import CampaignWriter
from agglom_mpi.variables import TEN

PLAIN = [name for name in sample_dtype.names if name != "crc"]


@pytest.fixture
def writer(path):
    with CampaignWriter(path) as writer:
        yield writer


def test_strings(path, writer):
    first, second = put_strings(writer, 0, 3), put_strings(writer, 3, 2)
    rows = read_campaign(path).string_rows()
    assert rows["string"].tolist() == [0, 1, 2, 3, 4]
    assert rows["slot"].tolist() == [0, 1, 2, 0, 1]
    assert set(rows["generation"]) == {2}
    assert rows["parents"].tolist() == [[-1, 3]] * 5
    stored = np.column_stack([rows[name] for name in TEN.names])
    assert np.array_equal(stored, np.vstack([first, second]))


def test_samples_in_any_order(path, writer):
    rows = np.concatenate([sample_rows(3, 0, 9), sample_rows(2, 95, 5), sample_rows(7, 4, 1)])
    put_strings(writer, 0, 8)
    shuffled = np.random.default_rng(1).permutation(rows)
    writer.put_samples(shuffled[:6])
    writer.put_samples(shuffled[6:])
    writer.flush()
    campaign = read_campaign(path)
    expected = rows[np.lexsort((rows["sample"], rows["string"]))]
    assert np.array_equal(campaign.all_sample_rows()[PLAIN], expected[PLAIN])
    assert np.array_equal(campaign.sample_rows(3)[PLAIN], sample_rows(3, 0, 9)[PLAIN])
    assert len(campaign.sample_rows(0)) == 0


def test_the_writer_leaves_the_caller_s_rows_alone(writer):
    rows = sample_rows(0, 0, 4)
    writer.put_samples(rows)
    rows["objective"] = -1
    writer.flush()
    assert not rows["crc"].any()
    assert (read_campaign(writer.path).sample_rows(0)["objective"] != -1).all()


def test_the_first_of_two_rows_for_one_sample_stays(path, writer):
    late = sample_rows(0, 0, 2)
    late["rank"] = 77
    writer.put_samples(sample_rows(0, 1, 1))
    writer.put_samples(late)
    writer.flush()
    assert read_campaign(path).sample_rows(0)["rank"].tolist() == [77, 1]


def test_samples_wait_for_company_but_not_for_long(path, writer, monkeypatch):
    most = 10 * MAX_SAMPLES  # as many as this file has room for several times
    monkeypatch.setattr(row_buffer, "FLUSH_ROWS", most)
    campaign, now = read_campaign(path), time.monotonic()
    writer.put_samples(sample_rows(0, 0, 3))
    assert len(campaign.sample_rows(0)) == 0
    assert not writer.flush_due(now)
    assert writer.flush_due(time.monotonic() + FLUSH_AGE)
    assert len(campaign.sample_rows(0)) == 3
    assert not writer.flush_due(time.monotonic() + FLUSH_AGE)
    enough = most // MAX_SAMPLES
    for string in range(1, 1 + enough):
        assert len(campaign.sample_rows(1)) == 0
        writer.put_samples(sample_rows(string, 0, MAX_SAMPLES))
    assert len(campaign.sample_rows(enough)) == MAX_SAMPLES


def test_a_result_never_precedes_its_samples(path, writer, monkeypatch):
    order, write = [], Rows.write

    def written(rows, first, new):
        order.append((rows.name, first, len(new)))
        write(rows, first, new)

    monkeypatch.setattr(Rows, "write", written)
    put_result(writer, 6, 0.25)
    writer.put_samples(sample_rows(5, 0, 3))
    put_result(writer, 5, 0.5)
    assert not order
    writer.flush()
    tables = [("/samples", 5 * MAX_SAMPLES, 3), ("/results", 5, 2)]
    assert order == [
        write for name, *where in tables for write in ((name, *where), (f"{name}_done", *where))
    ]
    row = read_campaign(path).result_rows()[0]
    assert (row["string"], row["objective"], row["samples_used"]) == (5, 0.5, 10)
    assert (row["failed"], row["hit_maximum"], row["growth_number"]) == (1, 1, 6.859)


def test_results_wait_for_company_but_not_for_long(path, writer):
    now = time.monotonic()
    put_result(writer, 5, 0.5)
    assert not writer.flush_due(now)
    assert len(read_campaign(path).result_rows()) == 0
    assert writer.flush_due(time.monotonic() + FLUSH_AGE)
    assert len(read_campaign(path).result_rows()) == 1
    assert not writer.flush_due(time.monotonic() + FLUSH_AGE)


def test_generations(path, writer):
    put_generation(writer, 0)
    row = read_campaign(path).generation_rows()[0]
    assert row["population"].tolist() == list(range(POPULATION))[::-1]
    assert (row["generation"], row["mean_of_top"], row["seconds"]) == (0, 0.5, 12.5)


def test_legs(path, writer):
    assert begin_leg(writer) == 0
    row = read_campaign(path).legs()[0]
    assert (row["exit_code"], row["ranks"], row["numba"]) == (-1, 4, b"")
    assert np.isnan(row["stopped"])
    assert row["host"].decode() == "knöten"
    assert len(row["mpi"]) == 64
    times = {"busy_seconds": 19.5, "cpu_seconds": 17.0, "database_seconds": 0.2}
    writer.log.end_leg(0, stopped=1e9 + 5, exit_code=75, samples=300, **times)
    row = read_campaign(path).legs()[0]
    assert (row["exit_code"], row["stopped"], row["samples"]) == (75, 1e9 + 5, 300)
    assert {name: row[name] for name in times} == times
    assert row["ranks"] == 4


def test_a_full_table_of_legs_keeps_its_last_row_current(path, writer):
    for leg in range(LEG_CAPACITY + 3):
        index = begin_leg(writer, float(leg))
    legs = read_campaign(path).legs()
    assert index == LEG_CAPACITY - 1
    assert legs["started"][-2:].tolist() == [LEG_CAPACITY - 2, LEG_CAPACITY + 2]


def test_a_full_table_of_failures_keeps_its_last_row_current(path, writer):
    room = []
    for sample in range(FAILURE_CAPACITY + 3):
        room.append(writer.log.has_room_for_failures)
        assert writer.log.put_failure(3, sample, rank=1, host="a", text=f"number {sample}")
    assert room == [True] * FAILURE_CAPACITY + [False] * 3
    rows = read_campaign(path).failures()
    assert len(rows) == FAILURE_CAPACITY
    assert rows["sample"][-2:].tolist() == [FAILURE_CAPACITY - 2, FAILURE_CAPACITY + 2]
    assert rows["text"][-1] == f"number {FAILURE_CAPACITY + 2}".encode()


def test_all_there_is_of_a_sample_that_took_too_long_is_not_overwritten(path, writer):
    for sample in range(FAILURE_CAPACITY):
        writer.log.put_failure(3, sample, rank=1, host="a", text="an exception")
    late = f"{TOOK_TOO_LONG} 3 s"
    assert writer.log.put_failure(4, 0, rank=1, host="a", text=late)
    assert not writer.log.put_failure(4, 1, rank=1, host="a", text=late)
    assert not writer.log.put_failure(4, 2, rank=1, host="a", text="an exception")
    assert read_campaign(path).failures()[["string", "sample"]].tolist()[-1] == (4, 0)


def test_failures_keep_the_end_of_a_long_text(path, writer):
    writer.log.put_failure(3, 4, rank=1, host="a", text="é" * 600 + "ValueError: no")
    writer.log.put_failure(3, 5, rank=1, host="a", text="short")
    rows = read_campaign(path).failures()
    assert rows["sample"].tolist() == [4, 5]
    text = rows["text"][0].decode()
    assert text.startswith("é")
    assert text.endswith("ValueError: no")
    assert len(text.encode()) in (999, 1000)
    assert rows["text"][1] == b"short"


def test_status(path, writer):
    assert open_campaign(path).status().state == "stopped"
    writer.set_status("running", "ä" * 100)
    status = read_campaign(path).status()
    assert status.state == "running"
    assert status.reason == "ä" * 64
    assert abs(status.updated - time.time()) < 60
    with pytest.raises(ValueError, match="sleeping"):
        writer.set_status("sleeping")


@pytest.mark.parametrize(("string", "sample"), [(-1, 0), (STRINGS, 0), (0, -1), (0, MAX_SAMPLES)])
def test_samples_without_a_place_are_refused_and_forgotten(path, writer, string, sample):
    writer.put_samples(sample_rows(0, 0, 1))
    with pytest.raises(IndexError, match="room"):
        writer.put_samples(sample_rows(string, sample, 1))
    writer.flush()
    assert len(read_campaign(path).all_sample_rows()) == 0, "its string was never stored"
    assert len(read_campaign(path).sample_rows(0)) == 1


def test_rows_beyond_the_room_are_refused(path, writer):
    with pytest.raises(IndexError, match=r"grains\.h5.*/results"):
        put_result(writer, STRINGS, 0.5)
    with pytest.raises(IndexError, match="/strings"):
        put_strings(writer, STRINGS - 1, 2)
    with pytest.raises(IndexError, match="/samples"):
        read_campaign(path).sample_rows(STRINGS)
    assert len(read_campaign(path).string_rows()) == 0


def test_a_failed_write_names_the_file_and_can_be_repeated(path, file_size_limit):
    writer = CampaignWriter(path)
    with open_file(path) as file:
        offset = file["samples"].id.get_offset()
    writer.put_samples(sample_rows(30, 0, 10))
    file_size_limit(offset + 1000)
    with pytest.raises(OSError, match=r"too large.*grains\.h5"):
        writer.flush()
    assert len(read_campaign(path).sample_rows(30)) == 0
    with pytest.raises(OSError, match=r"too large.*grains\.h5"):
        writer.close()
    assert not writer._file


def test_a_repeated_write_succeeds(path, writer, monkeypatch):
    table = writer.samples._samples.table
    put = table.write
    monkeypatch.setattr(table, "write", lambda *_, **__: (_ for _ in ()).throw(OSError(28, "full")))
    writer.put_samples(sample_rows(1, 0, 10))
    with pytest.raises(OSError, match="full"):
        writer.flush()
    monkeypatch.setattr(table, "write", put)
    writer.sync()
    assert len(read_campaign(path).sample_rows(1)) == 10


def test_a_checksum_from_where_a_sample_was_simulated_is_kept(path, writer):
    rows = sample_rows(1, 0, 4)
    rows["crc"] = checksums(rows)
    rows["crc"][2] ^= 1  # damaged on its way
    writer.put_samples(rows)
    writer.flush()
    assert read_campaign(path).sample_rows(1)["sample"].tolist() == [0, 1, 3]


def test_rows_of_a_closed_file_are_not_written_into_another_one(path, tmp_path):
    writer = CampaignWriter(path)
    rows = writer.samples._samples.table.rows
    writer.close()
    with (tmp_path / "other").open("wb") as other:  # it may get the descriptor
        with pytest.raises(ValueError, match="closed"):
            rows.write(0, sample_rows(0, 0, 1))
        with pytest.raises(ValueError, match="closed"):
            rows.read(0, 1)
        assert not other.tell()
    assert not (tmp_path / "other").read_bytes()


def test_closing_writes_what_waits_and_twice_is_harmless(path):
    writer = CampaignWriter(path)
    writer.put_samples(sample_rows(1, 0, 10))
    writer.close()
    writer.close()
    assert len(read_campaign(path).sample_rows(1)) == 10


def test_only_raw_data_changes(path):
    with h5py.File(path, "r") as file:
        raw = [(d.id.get_offset(), d.id.get_storage_size()) for d in file.values()]

    def metadata():
        content = bytearray(path.read_bytes())
        content[20] = 0
        for offset, size in raw:
            content[offset : offset + size] = bytes(size)
        return bytes(content)

    # Byte 20 of this superblock says "open for writing"; HDF5 heeds it in newer formats only.
    before = path.read_bytes()
    CampaignWriter(path).close()
    assert path.read_bytes() == before
    before = metadata()
    with CampaignWriter(path) as writer:
        begin_leg(writer)
        writer.set_status("running")
        put_strings(writer, 0, STRINGS)
        for string in range(STRINGS):
            writer.put_samples(sample_rows(string, 0, MAX_SAMPLES))
            put_result(writer, string, 0.1)
        put_generation(writer, 0)
        writer.sync()
        assert metadata() == before
    assert metadata() == before
