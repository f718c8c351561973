"""Labelled arrays of strings and samples."""

import gzip
import pickle
from pathlib import Path

import numpy as np
import pytest

from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.report import netcdf as module
from agglom_mpi.storage.reader import read_campaign

STORED = Path(__file__).parents[1] / "storage" / "files" / "version_2.h5.gz"


@pytest.fixture
def path(tmp_path):
    (tmp_path / "stored.h5").write_bytes(gzip.decompress(STORED.read_bytes()))
    return tmp_path / "stored.h5"


def test_columns_of_strings_keep_their_values_whatever_they_are_called(path, monkeypatch):
    pytest.importorskip("xarray")
    table_of = module.table_of

    def with_derived(data, name):
        table = table_of(data, name)
        if name == "strings":
            table["present"], table["string_objective"] = 7.0, 8.0
        return table

    monkeypatch.setattr(module, "table_of", with_derived)
    data = read_campaign(path)
    found = module.sample_arrays(data)
    objective = table_of(data, "strings")["objective"].to_numpy()
    assert found["present"].dtype == bool
    assert (found["string_present"] == 7.0).all()
    assert (found["string_objective"] == 8.0).all()
    assert np.array_equal(found["string_string_objective"], objective, equal_nan=True)


def test_columns_have_their_own_units(path):
    pytest.importorskip("xarray")
    data = read_campaign(path)
    found = module.sample_arrays(data)
    units = module.table_of(data, "samples").attrs["units"]
    for name in ("seconds", "merges", "mean_radius_ratio"):
        assert found[name].attrs.get("units", "1") == (units[name] or "1")
    assert found["seconds"].attrs["units"] == "s"


def test_a_pickled_campaign_file_opens_its_file_again(path):
    file = open_campaign(path)
    again = pickle.loads(pickle.dumps(file))
    assert again.path == file.path.absolute()
    assert again.strings.equals(file.strings)
