"""The layout of censuses is an attribute of the file, and decides columns of its samples."""

import json
import math

import pytest

from agglom_mpi.measurements.layout import CensusLayout
from agglom_mpi.storage.attributes import earlier_data
from agglom_mpi.storage.room import CENSUS, TableSizes
from agglom_mpi.storage.schema import SAMPLES, samples_schema

LAYOUT = CensusLayout.between((2e-3, math.inf), 0.5, 4.0)
SIZES = TableSizes(8, 4, 2, 4, census=LAYOUT)


def test_a_layout_is_read_as_it_was_written():
    assert TableSizes.of(SIZES.attributes()) == SIZES._replace(generations=0)
    without = SIZES._replace(census=None).attributes()
    assert CENSUS not in without
    assert TableSizes.of(without).census is None


def test_the_attribute_names_the_edges_for_other_readers():
    entries = json.loads(SIZES.attributes()[CENSUS])
    assert entries["times"] == [2e-3, None]
    assert entries["edges"] == LAYOUT.edges.tolist()


def test_columns_have_the_shape_of_the_layout_and_samples_without_stay_as_they_are():
    dtype = samples_schema({}, LAYOUT).dtype
    assert dtype["class_counts"].shape == dtype["class_masses"].shape == (2, LAYOUT.classes)
    assert dtype["census_temperatures"].shape == dtype["largest_masses"].shape == (2,)
    assert samples_schema({}) is SAMPLES
    assert dtype.itemsize - SAMPLES.dtype.itemsize == LAYOUT.bytes
    assert {field.since for field in samples_schema({}, LAYOUT).at(4).fields} <= {1, 2, 3, 4}


@pytest.mark.parametrize(
    "change",
    [
        {"times": []},
        {"times": [2.0, 1.0]},
        {"classes": 0},
        {"classes": 10**9},
        {"lower": None},
        {"times": "now"},
    ],
    ids=str,
)
def test_a_damaged_layout_is_refused(change):
    entries = json.loads(SIZES.attributes()[CENSUS]) | change
    with pytest.raises(ValueError, match="census"):
        TableSizes.of(SIZES.attributes() | {CENSUS: json.dumps(entries)})


@pytest.mark.parametrize(
    "text", ["{", "[1]", '[{"legs": 1, "strings": "2", "data": {}}]', "[" * 10**5]
)
def test_a_damaged_history_of_the_data_is_refused(text):
    whole = {"earlier_data": '[{"legs": 1, "strings": 2, "data": {"data.0.value": 1.0}}]'}
    assert earlier_data({}) == []
    assert earlier_data(whole)[0]["strings"] == 2
    with pytest.raises(ValueError, match="earlier_data"):
        earlier_data({"earlier_data": text})
