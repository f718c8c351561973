"""Another program truncates or overwrites a file that is being written."""

import os
import shutil

import h5py
import pytest
from storage_rows import make, put_strings, sample_rows

from agglom_mpi.storage.files import AlteredFileError
from agglom_mpi.storage.writer import CampaignWriter


def truncate(path):
    os.truncate(path, 3000)


def lengthen(path):
    with path.open("ab") as file:
        file.write(b"more")


def zero_superblock(path):
    with path.open("r+b") as file:
        file.write(bytes(96))


def zero_all(path):
    size = path.stat().st_size
    with path.open("r+b") as file:
        file.write(bytes(size))


def overwrite_header(path):
    with h5py.File(path, "r", locking=False) as file:
        place = file["samples"].id.get_offset() - 1
    with path.open("r+b") as file:
        file.seek(place)
        byte = file.read(1)[0]
        file.seek(place)
        file.write(bytes([byte ^ 1]))


def copy_another_over_it(path):
    shutil.copyfile(make(path.with_name("other.h5"), title="another"), path)


def copy_an_older_over_it(path):
    shutil.copyfile(path.with_name("older.h5"), path)


ALTERATIONS = [
    truncate,
    lengthen,
    zero_superblock,
    zero_all,
    overwrite_header,
    copy_another_over_it,
    copy_an_older_over_it,
]


@pytest.fixture
def writer(path):
    """Return a writer with rows in the file and in its buffer."""
    shutil.copyfile(path, path.with_name("older.h5"))
    writer = CampaignWriter(path)
    writer.set_status("running")
    put_strings(writer, 0, 5)
    writer.put_samples(sample_rows(0, 0, 9))
    writer.flush()
    writer.put_samples(sample_rows(1, 0, 9))
    return writer


@pytest.mark.parametrize("alter", ALTERATIONS)
def test_the_next_flush_notices_and_leaves_the_file_as_it_is(writer, path, alter):
    alter(path)
    found = path.read_bytes()
    with pytest.raises(AlteredFileError) as caught:
        writer.flush_due(now=1e30)
    assert caught.value.filename == str(path)
    writer.abandon(str(caught.value))
    assert path.read_bytes() == found


@pytest.mark.parametrize("alter", [truncate, zero_superblock, copy_an_older_over_it])
def test_the_end_notices_too(writer, path, alter):
    writer.sync()
    alter(path)
    found = path.read_bytes()
    with pytest.raises(AlteredFileError):
        writer.close()
    assert path.read_bytes() == found


def test_what_a_run_writes_itself_is_no_alteration(path):
    for state in ("running", "stopped", "finished"):
        with CampaignWriter(path) as writer:
            writer.set_status(state)
            put_strings(writer, 0, 5)
            writer.put_samples(sample_rows(2, 0, 100))
            writer.log.put_failure(1, 2, rank=3, host="b", text="broken")
            writer.sync()
            writer.set_status("running", "once more")
    with h5py.File(path, "r") as file:
        assert file["samples_done"][200:300].all()
