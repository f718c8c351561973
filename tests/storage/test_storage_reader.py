import os
import subprocess
import sys

import h5py
import numpy as np
import pytest
from storage_rows import STRINGS, TEXT, put_generation, put_result, put_strings, sample_rows

import agglom_mpi
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.storage.reader import NotACampaign, read_campaign
from agglom_mpi.storage.schema import FORMAT_VERSION
from agglom_mpi.storage.writer import CampaignWriter
from agglom_mpi.variables import TEN


@pytest.fixture
def campaign(path):
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 5)
        for string in (0, 1, 2):
            writer.put_samples(sample_rows(string, 0, 12))
        failed = sample_rows(2, 12, 1)
        failed["state"], failed["reason"], failed["objective"] = 2, 3, np.nan
        writer.put_samples(failed)
        put_result(writer, 0, 0.3)
        put_result(writer, 1, 0.1)
        put_result(writer, 2, 0.1, used=13)
        put_result(writer, 4, np.inf)
        put_generation(writer, 0)
    return open_campaign(path)


def test_attributes(campaign):
    assert campaign.campaign_text == TEXT
    data = read_campaign(campaign.path)
    assert data.identity == {"particles": 100, "box": [0.1, 30.0]}
    assert campaign.seed == 2**62 + 1
    assert data.max_samples == 100
    assert type(data.attributes["strings"]) is int
    assert "grünes Korn" in repr(campaign)


def test_strings_table(campaign):
    table = campaign.strings
    assert list(table.columns) == [
        "string",
        "generation",
        "slot",
        "origin",
        "parent_1",
        "parent_2",
        *TEN.names[:-1],
        "objective",
        "standard_error",
        "mean_radius_ratio",
        "mean_grains",
        "growth_number",
        "samples_used",
        "failed",
        "hit_maximum",
        "seconds",
        "cpu_seconds",
    ]
    assert len(table) == 5
    assert set(table["origin"]) == {"offspring"}
    assert table["samples_used"].tolist() == [10, 10, 13, 0, 10]
    assert table["samples_used"].dtype == np.int64
    assert table["hit_maximum"].tolist() == [False, True, False, False, False]
    assert np.isnan(table["objective"][3])
    units = table.attrs["units"]
    assert (units["hardness"], units["objective"], units["parent_1"]) == ("Pa", "1", "")
    assert set(units) == set(table.columns)


def test_samples_table(campaign):
    table = campaign.samples
    assert list(table.columns[:5]) == ["string", "sample", "state", "used", "reason"]
    assert "crc" not in table
    assert table.groupby("string")["used"].sum().tolist() == [10, 10, 13]
    failed = table[table["state"] == "failed"].iloc[0]
    assert (failed["string"], failed["sample"], failed["used"]) == (2, 12, True)
    assert failed["reason"] == "budget of steps or events exceeded"
    assert table.attrs["units"]["mean_temperature"] == "K"


def test_generations_and_variables_tables(campaign):
    generations = campaign.generations
    assert generations["population"][0].tolist() == [5, 4, 3, 2, 1, 0]
    assert generations.attrs["units"]["seconds"] == "s"
    variables = campaign.variables
    assert variables["name"].tolist() == list(TEN.names[:-1])
    assert variables["searched"].tolist() == [True] * 8 + [False]


def test_best_is_ascending_and_ties_go_by_number(campaign):
    assert campaign.best(3)["string"].tolist() == [1, 2, 0]
    assert campaign.best(99)["string"].tolist() == [1, 2, 0, 4]
    assert campaign.best()["string"].tolist() == [1]


def test_tables_of_an_empty_campaign(path):
    campaign = open_campaign(path)
    tables = (campaign.strings, campaign.samples, campaign.generations, campaign.best(3))
    assert [len(table) for table in tables] == [0, 0, 0, 0]
    assert "objective" in tables[0]


def test_a_row_with_a_wrong_checksum_is_absent(path, campaign):
    with h5py.File(path, "r+") as file:
        row = file["samples"][105]
        row["objective"] += 1
        file["samples"][105] = row
        file["results_done"][3] = 1
    data = read_campaign(path)
    assert data.sample_rows(1)["sample"].tolist() == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11]
    assert campaign.damaged == 2
    assert data.result_rows()["string"].tolist() == [0, 1, 2, 4]
    assert len(campaign.samples) == 36
    with CampaignWriter(path) as writer:
        writer.put_samples(sample_rows(1, 5, 1))
    assert len(read_campaign(path).sample_rows(1)) == 12
    assert campaign.damaged == 1


def test_a_row_without_its_done_byte_is_absent(path, campaign):
    with h5py.File(path, "r+") as file:
        file["samples_done"][0] = 0
    assert read_campaign(path).sample_rows(0)["sample"][0] == 1
    assert campaign.damaged == 0


def cut(path, size):
    os.truncate(path, size)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda path: path.write_text("title: no\n"), "not an HDF5 file"),
        (lambda path: path.write_bytes(b""), "not an HDF5 file"),
        (lambda path: cut(path, 5), "not an HDF5 file"),
        (lambda path: cut(path, 90), "truncated"),
        (lambda path: cut(path, 3000), "truncated"),
        (lambda path: cut(path, path.stat().st_size - 1), "truncated"),
    ],
)
def test_a_file_that_is_no_hdf5(path, spoil, message):
    spoil(path)
    for opened in (open_campaign, CampaignWriter):
        with pytest.raises(NotACampaign, match=message) as caught:
            opened(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)


NEWER = FORMAT_VERSION + 1


def set_attribute(name, value):
    def change(file):
        file.attrs[name] = value

    return change


def remove_table(file):
    del file["results_done"]


def other_columns(file):
    del file["legs"]
    file["legs"] = np.zeros(3, [("a", "f8")])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (set_attribute("format", "something else"), "not an agglom_mpi campaign"),
        (set_attribute("format_version", NEWER), f"version {NEWER}, .*: update agglom_mpi"),
        (set_attribute("format_version", 2**40), "version 1099511627776, .*: update"),
        (set_attribute("format_version", 0), "without a format version"),
        (lambda file: file.attrs.pop("format_version"), "without a format version"),
        (set_attribute("format_version", "two"), "damaged"),
        (remove_table, "damaged"),
        (other_columns, "/legs has other columns"),
    ],
)
def test_hdf5_that_is_no_campaign_of_this_version(path, change, message):
    with h5py.File(path, "r+") as file:
        change(file)
    before = path.read_bytes()
    for opened in (open_campaign, CampaignWriter):
        with pytest.raises(NotACampaign, match=message) as caught:
            opened(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
    assert path.read_bytes() == before


def test_other_hdf5_file(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(NotACampaign, match="not an agglom_mpi campaign"):
        open_campaign(tmp_path / "other.h5")


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"missing\.h5"):
        open_campaign(tmp_path / "missing.h5")
    with pytest.raises(IsADirectoryError):
        open_campaign(tmp_path)


LOOK = """
import sys, h5py
from agglom_mpi.storage.reader import read_campaign
campaign = read_campaign(sys.argv[1])
with h5py.File(sys.argv[1], "r", locking=False) as file:
    plain = int(file["samples_done"][:].sum())
print(len(campaign.string_rows()), len(campaign.all_sample_rows()), plain)
"""


def test_another_process_sees_what_was_written_without_a_flush_of_hdf5(path):
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 4)
        writer.put_samples(sample_rows(3, 7, 5))
        writer.flush()
        look = [sys.executable, "-c", LOOK, str(path)]
        seen = subprocess.run(look, capture_output=True, text=True, check=True).stdout
        with h5py.File(path, "r", locking=False) as file:
            done, rows = file["samples_done"].id.get_offset(), file["samples"].id.get_offset()
            size = file["samples"].dtype.itemsize
        content = path.read_bytes()
        assert content[done + 307 : done + 312] == bytes([1] * 5)
        assert any(content[rows + 311 * size : rows + 312 * size])
    assert seen.split() == ["4", "5", "5"]


def test_a_reader_follows_the_writer_in_the_same_process(path):
    campaign = open_campaign(path)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, STRINGS)
        for string in range(STRINGS):
            writer.put_samples(sample_rows(string, 0, 5))
            writer.flush()
            assert len(campaign.samples) == 5 * (string + 1)
        put_result(writer, 3, 0.5)
        writer.flush()
        assert campaign.best(1)["string"][0] == 3
        put_result(writer, 4, 0.4)
    assert campaign.best(1)["string"][0] == 4
    assert len(campaign.samples) == 5 * STRINGS


def test_importing_the_reader_is_cheap():
    heavy = (
        "import sys, agglom_mpi.storage.reader as r; print({'pandas', 'mpi4py'} & {*sys.modules})"
    )
    run = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_tables_without_pandas_say_what_to_install(campaign, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r"pip install 'agglom_mpi\[report\]'"):
        _ = campaign.samples
    assert len(read_campaign(campaign.path).all_sample_rows()) == 37


def test_the_package_offers_it(path):
    assert agglom_mpi.open_campaign(path).seed == 2**62 + 1
