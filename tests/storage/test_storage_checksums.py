"""Everything that is stored has a checksum, which check, report and resume compare."""

import json
import logging

import h5py
import numpy as np
import pytest
from storage_rows import make, put_strings

from agglom_mpi.storage.access import NotACampaign
from agglom_mpi.storage.attributes import altered_parts
from agglom_mpi.storage.compact import write_compact
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.verify import verify_rows
from agglom_mpi.storage.writer import CampaignWriter


def set_attribute(name, value, dataset=None):
    def change(file):
        (file if dataset is None else file[dataset]).attrs[name] = value

    return change


def widen(file):
    rows = file["variables"][...]
    rows["upper"][0] *= 2.0
    file["variables"][...] = rows


ALTERED = {
    "campaign": set_attribute("campaign", "title: another"),
    "title": set_attribute("title", "another"),
    "created": set_attribute("created", "2001-01-01"),
    "seed": set_attribute("seed", 3),
    "fresh_from": lambda file: file.attrs.pop("fresh_from"),
    "purpose": lambda file: file.attrs.pop("purpose"),
    "samples/meaning": set_attribute("meaning", "other", "samples"),
    "legs/field_units": set_attribute("field_units", ["s"], "legs"),
    "/variables": widen,
    "checksums": set_attribute("checksums", "["),
}


@pytest.mark.parametrize(("name", "change"), ALTERED.items(), ids=ALTERED)
def test_what_was_altered_is_named(path, caplog, name, change):
    assert read_campaign(path).altered == []
    with h5py.File(path, "r+") as file:
        change(file)
    with caplog.at_level(logging.WARNING):
        assert read_campaign(path).altered == [name]
    assert str(path) in caplog.text
    assert name in caplog.text
    assert [fault for fault in verify_rows(path).faults if name in fault]


def test_a_file_without_its_checksums_is_altered_and_an_older_one_is_not(path):
    with h5py.File(path, "r+") as file:
        del file.attrs["checksums"]
        assert altered_parts(file) == ["checksums"]
        file.attrs["format_version"] = 5
        assert altered_parts(file) == []


def test_every_attribute_and_an_added_one_are_known(path):
    with h5py.File(path, "r+") as file:
        known = json.loads(file.attrs["checksums"])
        parts = {"": file, **{f"{name}/": part for name, part in file.items()}}
        names = {f"{table}{key}" for table, part in parts.items() for key in part.attrs}
        assert known.keys() == {*names, "/variables"} - {"checksums"}
        file.attrs["note"] = "by somebody else"
        assert altered_parts(file) == []


def test_a_copy_of_an_altered_file_is_altered(path, tmp_path):
    write_compact(path, tmp_path / "sound.h5")
    assert read_campaign(tmp_path / "sound.h5").altered == []
    with h5py.File(path, "r+") as file:
        file.attrs["title"] = "another"
    write_compact(path, tmp_path / "copy.h5")
    assert read_campaign(tmp_path / "copy.h5").altered == ["title"]


@pytest.mark.parametrize("place", [3, 20, 30, 140])
def test_a_flipped_bit_of_the_status_is_found_and_written_anew(path, place):
    with CampaignWriter(path) as writer:
        writer.set_status("finished", "all done")
    with h5py.File(path, "r+") as file:
        rows = np.frombuffer(bytearray(file["status"][...].tobytes()), file["status"].dtype)
        rows.view(np.uint8)[place] ^= 1
        file["status"][...] = rows
    assert read_campaign(path).damaged == 1
    report = verify_rows(path)
    assert report.lost["status"] == {0}
    assert len(report.losses) == 1
    with CampaignWriter(path) as writer:
        writer.set_status("stopped")
    assert read_campaign(path).damaged == 0
    assert not verify_rows(path).losses


def in_chunks(name):
    def change(file):
        rows, attributes = file[name][...], dict(file[name].attrs)
        del file[name]
        file.create_dataset(name, data=rows, chunks=(4,)).attrs.update(attributes)

    return change


@pytest.mark.parametrize("name", ["legs", "strings_done", "samples"])
def test_a_table_rewritten_in_chunks_is_read_but_not_continued(path, name):
    with h5py.File(path, "r+") as file:
        in_chunks(name)(file)
    report = verify_rows(path)
    assert len(report.faults) == (name != "samples")  # or it is a compact copy
    assert all(f"/{name} lies in chunks" in fault for fault in report.faults)
    with pytest.raises(NotACampaign, match=rf"grains\.h5: .*/{name} lies in chunks.*--output"):
        CampaignWriter(path)


def test_appended_bytes_are_cut_off_before_the_run(path):
    size = path.stat().st_size
    with path.open("ab") as file:
        file.write(b"more")
    with CampaignWriter(path) as writer:
        assert path.stat().st_size == size
        read_campaign(path).string_rows()
        writer.set_status("running")
        put_strings(writer, 0, 5)
    assert len(read_campaign(path).string_rows()) == 5


def test_a_file_that_was_moved_is_named_with_its_new_name(path, tmp_path):
    writer = CampaignWriter(path)
    try:
        put_strings(writer, 0, 5)
        moved = path.rename(tmp_path / "moved.h5")
        with pytest.raises(FileNotFoundError) as caught:
            writer.set_status("running")
        assert str(moved) in str(caught.value)
        moved.unlink()
        with pytest.raises(FileNotFoundError) as caught:
            writer.set_status("running")
        assert str(moved) not in str(caught.value)
        make(path)  # another one in its place
        with pytest.raises(FileNotFoundError, match="lost"):
            writer.set_status("running")
    finally:
        writer.abandon("lost")
