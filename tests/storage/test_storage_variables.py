"""Files of campaigns with variables beside those of the papers."""

import json

import h5py
import numpy as np
import pytest
from storage_rows import LOWER, UPPER, make

from agglom_mpi.storage.access import NotACampaign
from agglom_mpi.storage.create import enlarge_campaign_file
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.room import FURTHER_VARIABLES, TableSizes
from agglom_mpi.storage.schema import parameters_of
from agglom_mpi.storage.writer import CampaignWriter
from agglom_mpi.variables import MAX_VARIABLE_NAME, TEN, Variable, VariableTable

LONG = "restitution." + "x" * (MAX_VARIABLE_NAME - len("restitution."))
TABLE = VariableTable(
    [Variable("sizes.spread", "1", "", "spread of sizes"), Variable("end_time", "s", "", "an end")]
)
BOX = {"lower": np.append(LOWER, [1e-3, 1.1]), "upper": np.append(UPPER, [2e-3, 1.1])}


def put(writer: CampaignWriter, first: int, count: int, columns: int) -> np.ndarray:
    parameters = np.random.default_rng(first).random((count, columns))
    parents = np.full((count, 2), -1)
    writer.put_strings(first, 0, np.arange(count), np.zeros(count), parents, parameters)
    return parameters


@pytest.fixture
def path(tmp_path):
    return make(tmp_path / "further.h5", variables=TABLE, **BOX)


def test_strings_of_further_variables_are_read_as_written(path):
    with CampaignWriter(path) as writer:
        written = put(writer, 0, 7, TABLE.count)
    file = read_campaign(path)
    assert file.variables.names == TABLE.names
    assert [each.unit for each in file.variables.further] == ["s", "1"]
    assert np.array_equal(parameters_of(file.string_rows()), written)
    assert np.array_equal(file.values([3, 5], "sizes.spread"), written[[3, 5], -1])
    assert file.variable_rows()["searched"].tolist()[-2:] == [1, 0]


def test_a_file_with_more_room_keeps_them(path):
    with CampaignWriter(path) as writer:
        written = put(writer, 0, 7, TABLE.count)
    more = TableSizes(80, 100, 5, 6, variables=TABLE)
    assert enlarge_campaign_file(path, more)
    file = read_campaign(path)
    assert file.variables.names == TABLE.names
    assert np.array_equal(parameters_of(file.string_rows()), written)


def test_a_file_of_the_ten_alone_does_not_mention_others(tmp_path):
    path = make(tmp_path / "ten.h5")
    with h5py.File(path) as file:
        assert FURTHER_VARIABLES not in file.attrs
        assert file["variables"].dtype["name"].itemsize == 32
    assert read_campaign(path).variables == TEN


def test_the_longest_name_fits(tmp_path):
    table = VariableTable([Variable(LONG, "1", "", "")])
    box = {"lower": np.append(LOWER, 0.0), "upper": np.append(UPPER, 1.0)}
    path = make(tmp_path / "long.h5", variables=table, **box)
    assert read_campaign(path).variables.names[-1] == LONG
    with h5py.File(path) as file:
        assert file["variables"]["name"][-1].decode() == LONG


def test_each_variable_takes_its_room():
    sizes = [TableSizes(1000, 1, 1, 1, variables=table) for table in (TEN, TABLE)]
    assert sizes[1].file_bytes() - sizes[0].file_bytes() == 2 * (8 * 1000 + 32 + 16 + 17)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        "[1]",
        '[["sizes.spread", "1"]]',
        '[["sizes.spread", 1, ""]]',
        '[["density", "kg/m^3", ""]]',
        '[["sizes.spread", "1", ""], ["sizes.spread", "1", ""]]',
        '[["crc spread", "1", ""]]',
        json.dumps([[LONG + "x", "1", ""]]),
        json.dumps([["end_time", "s", ""]]),  # fewer than the columns of the tables
    ],
)
def test_an_altered_attribute_is_damage(path, text):
    with h5py.File(path, "r+") as file:
        file.attrs[FURTHER_VARIABLES] = text
    with pytest.raises(NotACampaign):
        read_campaign(path)


def test_names_of_other_variables_are_damage(path):
    with h5py.File(path, "r+") as file:
        rows = file["variables"][:]
        rows["name"][-1] = b"sizes.median"
        file["variables"][:] = rows
    with pytest.raises(NotACampaign, match="names"):
        read_campaign(path)


def test_variables_are_kept_by_their_attribute():
    attributes = TableSizes(2, 2, 2, 2).attributes()
    assert TableSizes.of(attributes).variables is TEN
    attributes[FURTHER_VARIABLES] = '[["a.b", "s", "m"]]'
    assert TableSizes.of(attributes).variables["a.b"].meaning == "m"
