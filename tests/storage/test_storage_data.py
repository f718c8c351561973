"""The rows of a file, kept as they were read, and refreshed while the file grows."""

import h5py
import numpy as np
import pytest
from storage_rows import put_result, put_strings, sample_rows

from agglom_mpi.storage import table
from agglom_mpi.storage.reader import CampaignData, read_campaign
from agglom_mpi.storage.writer import CampaignWriter


@pytest.fixture
def writer(path):
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 3)
        writer.put_samples(sample_rows(1, 0, 5))
        writer.flush()
        yield writer


@pytest.fixture
def samples_read(monkeypatch):
    """Return a list that gets the number of rows of `/samples` with every reading of them."""
    counts, read = [], table.Rows.read_into

    def counted(self, first, rows):
        if self.name == "/samples":
            counts.append(len(rows))
        read(self, first, rows)

    monkeypatch.setattr(table.Rows, "read_into", counted)
    return counts


def test_rows_stay_what_they_were_until_they_are_refreshed(path, writer):
    data = read_campaign(path)
    assert len(data.string_rows()) == 3
    put_result(writer, 1, 0.5)
    writer.flush()
    assert len(data.result_rows()) == 0, "read together with the strings"
    data.refresh()
    assert data.result_rows()["string"].tolist() == [1]


def test_no_sample_is_read_of_a_string_that_came_later(path, writer):
    data = read_campaign(path)
    data.string_rows()
    put_strings(writer, 3, 1)
    writer.put_samples(sample_rows(3, 0, 2))
    writer.put_samples(sample_rows(2, 0, 1))
    writer.flush()
    assert data.all_sample_rows()["string"].tolist() == [1] * 5 + [2]
    data.refresh()
    assert data.all_sample_rows()["string"].tolist() == [1] * 5 + [2] + [3] * 2


def test_a_refresh_reads_new_samples_alone_and_puts_them_in_their_order(path, writer, samples_read):
    data = read_campaign(path)
    data.all_sample_rows()
    writer.put_samples(sample_rows(0, 3, 2))
    writer.put_samples(sample_rows(2, 0, 1))
    writer.put_samples(sample_rows(1, 5, 1))
    writer.flush()
    samples_read.clear()
    data.refresh()
    assert sum(samples_read) == 4
    rows = data.all_sample_rows()
    assert rows[["string", "sample"]].tolist() == [
        *((0, number) for number in (3, 4)),
        *((1, number) for number in range(6)),
        (2, 0),
    ]
    assert rows.tobytes() == read_campaign(path).all_sample_rows().tobytes()


def test_without_need_no_sample_is_read(path, writer, samples_read):
    data = read_campaign(path)
    data.refresh()
    assert (len(data.string_rows()), len(data.legs()), data.status().state) == (3, 0, "stopped")
    assert samples_read == []
    assert len(data.sample_rows(1)) == 5
    assert samples_read == [5]


def test_only_the_columns_that_are_asked_for_are_kept(path, writer):
    whole = read_campaign(path)
    data = CampaignData(path, whole.attributes, ("string", "sample", "seconds"))
    assert data.all_sample_rows().dtype.itemsize == 24
    writer.put_samples(sample_rows(0, 0, 2))
    writer.flush()
    data.refresh()
    for name in ("string", "sample", "seconds"):
        assert data.all_sample_rows()[name].tolist() == whole.all_sample_rows()[name].tolist()


def test_a_damaged_sample_is_read_again_until_it_is_whole(path, writer):

    with h5py.File(path, "r+", locking=False) as file:
        row = file["samples"][102]
        file["samples"][102] = np.zeros((), row.dtype)
    data = read_campaign(path)
    assert (len(data.all_sample_rows()), data.damaged) == (4, 1)
    with h5py.File(path, "r+", locking=False) as file:
        file["samples"][102] = row
    data.refresh()
    assert (len(data.all_sample_rows()), data.damaged) == (5, 0)


def test_what_is_derived_is_computed_once_for_the_same_rows(path, writer):
    data, calls = read_campaign(path), []

    def count(rows):
        calls.append(rows)
        return len(rows.all_sample_rows())

    assert (data.derived(count), data.derived(count), len(calls)) == (5, 5, 1)
    writer.put_samples(sample_rows(0, 0, 2))
    writer.flush()
    data.refresh()
    assert (data.derived(count), len(calls)) == (7, 2)


def test_rows_cannot_be_changed_by_those_who_share_them(path, writer):
    data = read_campaign(path)
    for rows in (data.string_rows(), data.all_sample_rows(), data.sample_rows(1)):
        with pytest.raises(ValueError, match="read-only"):
            rows["string"] = 0
