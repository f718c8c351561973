import json
import os

import h5py
import numpy as np
import pytest
from storage_rows import (
    GENERATIONS,
    LOWER,
    MAX_SAMPLES,
    STRINGS,
    TEXT,
    UPPER,
    make,
    sample_rows,
    table_room,
)

from agglom_mpi.outcome import OUTCOME
from agglom_mpi.storage.create import create_campaign_file, enlarge_campaign_file
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.schema import sample_dtype
from agglom_mpi.storage.writer import CampaignWriter
from agglom_mpi.variables import TEN


def test_every_dataset_and_field_is_explained(path):
    with h5py.File(path, "r") as file:
        known = {table.name: table for table in table_room(STRINGS, GENERATIONS).tables()}
        done = {table.done for table in known.values() if table.final}
        assert set(file) == set(known) | done
        for name, dataset in file.items():
            assert dataset.attrs["meaning"]
            assert dataset.attrs["row"]
            if name in known:
                assert len(dataset.attrs["field_units"]) == len(dataset.dtype.names)
                assert len(dataset.attrs["field_meanings"]) == len(dataset.dtype.names)
                assert all(dataset.attrs["field_meanings"])
            else:
                assert dataset.attrs["unit"] == ""
        assert file["samples"].attrs["row"] == "row = string * max_samples + sample"
        assert len(file["samples"]) == len(file["samples_done"]) == STRINGS * MAX_SAMPLES


def test_datasets_are_contiguous_and_in_the_oldest_format(path):
    with h5py.File(path, "r") as file:
        for dataset in file.values():
            creation = dataset.id.get_create_plist()
            assert creation.get_layout() == h5py.h5d.CONTIGUOUS
            assert creation.get_alloc_time() == h5py.h5d.ALLOC_TIME_EARLY
            assert creation.get_fill_time() == h5py.h5d.FILL_TIME_NEVER
            assert dataset.id.get_offset() is not None
    assert path.read_bytes()[8] == 0, "superblock version"


def test_root_attributes(path):
    with h5py.File(path, "r") as file:
        attributes = dict(file.attrs)
    assert attributes["campaign"] == TEXT
    assert attributes["seed"] == 2**62 + 1
    assert attributes["max_samples"] == MAX_SAMPLES
    assert attributes["strings"] == STRINGS
    assert json.loads(attributes["identity"])["particles"] == 100


def test_sample_rows_hold_every_column_of_an_outcome():
    assert sample_dtype.names[:2] == ("string", "sample")
    assert sample_dtype.names[2 : 2 + len(OUTCOME.names)] == OUTCOME.names
    assert sample_dtype.names[-1] == "crc"
    assert all(sample_dtype[name] == OUTCOME[name] for name in OUTCOME.names)


def test_variables_say_what_is_searched(path):
    with h5py.File(path, "r") as file:
        rows = file["variables"][:]
    assert [name.decode() for name in rows["name"]] == list(TEN.names)
    assert np.array_equal(rows["lower"], LOWER, equal_nan=True)
    assert np.array_equal(rows["upper"], UPPER, equal_nan=True)
    assert rows["searched"].tolist() == [1] * 8 + [0, 0]


def test_unwritten_space_is_a_hole(tmp_path):
    path = make(tmp_path / "wide.h5", strings=1000, max_samples=1000, text="a: 1")
    assert path.stat().st_size > 150e6
    assert path.stat().st_blocks * 512 < 1e6
    with CampaignWriter(path) as writer:
        writer.put_samples(sample_rows(500, 500, 3))
    enlarge_campaign_file(path, table_room(2000, 5))
    assert path.stat().st_size > 300e6
    assert path.stat().st_blocks * 512 < 1e6


def test_an_existing_file_is_not_overwritten(path):
    before = path.read_bytes()
    with pytest.raises(FileExistsError, match=r"grains\.h5"):
        make(path)
    assert path.read_bytes() == before


def test_a_failed_creation_leaves_nothing(tmp_path, file_size_limit):
    file_size_limit(100_000)
    with pytest.raises(OSError, match=r"too large.*broken\.h5"):
        make(tmp_path / "broken.h5")
    assert os.listdir(tmp_path) == []


def test_creation_in_a_missing_folder_names_the_file(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere/new\.h5"):
        make(tmp_path / "nowhere" / "new.h5")


def test_a_file_without_room_is_refused(tmp_path):
    with pytest.raises(ValueError, match="room"):
        make(tmp_path / "none.h5", generations=0)


def test_a_symbolic_link_keeps_pointing_at_the_file(tmp_path):
    (tmp_path / "disc").mkdir()
    link = tmp_path / "grains.h5"
    link.symlink_to(tmp_path / "disc" / "real.h5")
    make(link)
    enlarge_campaign_file(link, table_room(STRINGS + 1, 1))
    assert link.is_symlink()
    assert os.listdir(tmp_path / "disc") == ["real.h5"]


def test_a_stale_temporary_file_is_no_obstacle(tmp_path):
    (tmp_path / ".grains.h5.new").write_text("left by a kill")
    make(tmp_path / "grains.h5")
    assert os.listdir(tmp_path) == ["grains.h5"]


def test_create_needs_a_record_and_sizes(tmp_path):
    with pytest.raises(TypeError):
        create_campaign_file(tmp_path / "a.h5", "text")


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        *((text, "no list") for text in (7, "2 x", "2  4", "²", "-2")),
        *((text, "not ascending from 2") for text in ("4 2", "2 2", "1 4")),
    ],
)
def test_an_attribute_of_volumes_that_no_run_writes_is_refused(text, fault):
    with pytest.raises(ValueError, match=f"volumes is {fault}"):
        TableSizes.of(table_room(2, 2).attributes() | {"volumes": text})


def test_volumes_are_read_as_they_are_written():
    for volumes in ((), (2,), (2, 16, 128)):
        sizes = table_room(2, 2, volumes=volumes[::-1])
        assert TableSizes.of(sizes.attributes()).volumes == volumes
