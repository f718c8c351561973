"""Files of older format versions are read, checked and continued."""

import gzip
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from campaign_runs import assert_sound, finish

import agglom_mpi
from agglom_mpi.analysis.derived import derived_columns
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.schema import FORMAT_VERSION, LEGS, Column, TableSchema
from agglom_mpi.storage.table import fitted

FILES = Path(__file__).parent / "files"


def unpacked(folder, version):
    """Copy a campaign of three generations and its file after two of them; return the folder.

    Written by commits 357adf2, bf3d894 and 309f7c1:
    `agglom-invert version_1.yaml --generations 2`.
    """
    return copied(folder, f"version_{version}")


def copied(folder, name):
    """Copy a campaign and its file into a folder; return the folder."""
    shutil.copy(FILES / f"{name}.yaml", folder)
    with gzip.open(FILES / f"{name}.h5.gz") as packed:
        (folder / f"{name}.h5").write_bytes(packed.read())
    return folder


@pytest.fixture
def old(tmp_path):
    """Folder of a campaign and its file of version 1."""
    return unpacked(tmp_path, 1)


def final_bytes(path):
    """Bytes of the final rows of each table, by table and place, as they are stored."""
    found = {}
    with h5py.File(path) as file:
        tables = ("strings", "results", "generations", "samples", "final_particles")
        for name in (name for name in tables if name in file):
            done = np.flatnonzero(file[f"{name}_done"][:])
            rows = file[name][:]
            found |= {(name, int(place)): rows[place].tobytes() for place in done}
    return found


def test_an_older_file_is_read(old):
    file = agglom_mpi.open_campaign(old / "version_1.h5")
    data = read_campaign(file.path)
    assert data.attributes["format_version"] == 1 < FORMAT_VERSION
    assert len(file.strings) == 6
    assert file.samples["used"].sum() == 36
    assert file.samples["fresh"].sum() == 6
    assert file.best()["string"].tolist() == [0]
    assert file.estimates["objective"][0] == pytest.approx(0.0520, abs=5e-5)
    assert file.final_particles(0, 0).radii.size > 0
    assert data.legs().dtype.names == tuple(field.name for field in LEGS.fields)
    assert data.legs()["scipy"].tolist() == [b""]


@pytest.mark.exact_bits
@pytest.mark.parametrize("version", [1, 2, 3])
def test_an_older_file_is_sound(tmp_path, version):
    path = unpacked(tmp_path, version) / f"version_{version}.h5"
    assert "2 of 2 populations" in assert_sound(path)


def test_a_file_without_processor_times_is_read(tmp_path):
    path = unpacked(tmp_path, 2) / "version_2.h5"
    file, data = agglom_mpi.open_campaign(path), read_campaign(path)
    assert data.attributes["format_version"] == 2 < FORMAT_VERSION
    assert file.samples["used"].sum() == 36
    assert np.isnan(file.samples["cpu_seconds"]).all()
    assert (file.samples["seconds"] > 0.0).all()
    assert np.isnan(file.strings["cpu_seconds"]).all()
    assert np.isnan(data.legs()["cpu_seconds"]).all()
    assert data.legs()["scipy"].tolist() != [b""]


def test_a_text_of_an_older_file_that_does_not_parse_is_noted(tmp_path):
    path = unpacked(tmp_path, 3) / "version_3.h5"
    with h5py.File(path, "r+") as file:
        file.attrs["campaign"] += "\nderived: ["
    data = read_campaign(path)
    assert data.altered == []  # it has no checksum
    assert derived_columns(data) == []
    assert data.altered == ["campaign"]


@pytest.mark.exact_bits
@pytest.mark.parametrize("version", [1, 3])
def test_an_older_file_is_continued_and_keeps_its_rows(tmp_path, version):
    folder = unpacked(tmp_path, version)
    path = folder / f"version_{version}.h5"
    before = final_bytes(path)
    finish(folder, f"version_{version}.yaml", "--accept-code-change")
    after = final_bytes(path)
    assert {place: after[place] for place in before} == before
    file = read_campaign(path)
    assert file.attributes["format_version"] == version
    assert len(file.generation_rows()) == 3
    assert len(file.legs()) == 2
    assert (file.legs()["busy_seconds"] > 0.0).all()
    assert_sound(path)
    with h5py.File(path) as raw:
        for table in ("samples", "legs"):
            assert ("cpu_seconds" in raw[table].dtype.names) == (version >= 3)


@pytest.mark.exact_bits
def test_a_search_for_the_set_that_an_earlier_version_began_is_continued(tmp_path):
    """Four of five generations, by commit bf3d894, which drew other batches from the same model."""
    path = copied(tmp_path, "begun_set") / "begun_set.h5"
    assert "4 of 4 populations" in assert_sound(path)
    before = final_bytes(path)
    finish(tmp_path, "begun_set.yaml", "--accept-code-change")
    after = final_bytes(path)
    assert {place: after[place] for place in before} == before
    assert "20 of 20 strings, 20 of 20 results and 5 of 5 populations" in assert_sound(path)
    origins = read_campaign(path).string_rows()["origin"]
    assert origins.tolist() == [0] * 8 + [2] * 12


@pytest.mark.exact_bits
def test_a_file_that_needs_more_room_keeps_its_version(old):
    finish(old, "version_1.yaml", "--generations", "7", "--accept-code-change")
    with h5py.File(old / "version_1.h5") as file:
        assert file.attrs["format_version"] == 1
        assert "scipy" not in file["legs"].dtype.names
    assert_sound(old / "version_1.h5")


def test_a_table_of_an_older_version_lacks_later_columns():
    table = TableSchema(
        "t", "", "", (Column("a", "f8", "", ""), Column("b", "i8", "", "", since=3))
    )
    assert table.at(2).dtype.names == ("a",)
    assert table.at(3).dtype.names == ("a", "b")


def test_rows_without_a_column_get_what_says_that_it_is_unknown():
    rows = np.array([(1.5, 7)], [("a", "f8"), ("dropped", "i8")])
    wanted = np.dtype([("a", "f8"), ("b", "i8"), ("c", "f8"), ("d", "S4")])
    [found] = fitted(rows, wanted).tolist()
    assert found[:2] == (1.5, 0)
    assert np.isnan(found[2])
    assert found[3] == b""


LATER_COLUMN = """    OutcomeColumn("extra", "f8", "1", "something measured later", since=FORMAT),
)
\"\"\"The columns of a sample that physics"""


@pytest.mark.slow
def test_a_column_that_is_added_later_locks_out_no_older_file(old, tmp_path):
    package = tmp_path / "later" / "agglom_mpi"
    shutil.copytree(Path(agglom_mpi.__file__).parent, package)
    replace(package / "outcome.py", BEFORE, LATER_COLUMN.replace("FORMAT", "9"))
    replace(
        package / "storage" / "schema.py",
        f"FORMAT_VERSION: Final = {FORMAT_VERSION}",
        "FORMAT_VERSION: Final = 9",
    )
    path, before = old / "version_1.h5", final_bytes(old / "version_1.h5")
    run = [old, "version_1.yaml"]
    finish(*run, "--accept-code-change", alone=True, PYTHONPATH=package.parent)
    after = final_bytes(path)
    assert {place: after[place] for place in before} == before
    assert_sound(path)  # as whoever wrote the first version sees it, the digests too
    finish(*run, "-o", "new.h5", alone=True, PYTHONPATH=package.parent)
    with h5py.File(old / "new.h5") as file:
        assert file.attrs["format_version"] == 9
        assert "extra" in file["samples"].dtype.names


BEFORE = """)
\"\"\"The columns of a sample that physics"""


def replace(path, old, new):
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
