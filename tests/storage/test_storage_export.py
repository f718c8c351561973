"""A compact copy holds the same rows, and nothing half written is ever under its name."""

import os
import signal

import h5py
import numpy as np
import pandas as pd
import pytest
from storage_rows import (
    MAX_SAMPLES,
    begin_leg,
    make,
    put_generation,
    put_result,
    put_strings,
    sample_rows,
    table_room,
)

from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.report.export import Exports, export, write_tables
from agglom_mpi.storage import compact
from agglom_mpi.storage import files as whole
from agglom_mpi.storage.compact import CopyCounts, write_compact
from agglom_mpi.storage.create import enlarge_campaign_file
from agglom_mpi.storage.files import CheckedFile
from agglom_mpi.storage.reader import NotACampaign, read_campaign
from agglom_mpi.storage.writer import CampaignWriter


def fill(writer):
    begin_leg(writer)
    put_strings(writer, 0, 7)
    for string in (0, 1, 5):
        writer.put_samples(sample_rows(string, string, 12))
    put_result(writer, 0, 0.3)
    put_result(writer, 5, np.inf)
    put_generation(writer, 0)
    put_generation(writer, 2)
    writer.log.put_failure(5, 3, rank=1, host="b", text="Überlauf")
    writer.set_status("finished", "all done")


@pytest.fixture
def filled(path):
    with CampaignWriter(path) as writer:
        fill(writer)
    return path


@pytest.fixture
def copy(tmp_path):
    return tmp_path / "copy.h5"


def contents(path):
    """Everything in a file, by name; tables cut after their last final row."""
    found = {}
    with h5py.File(path, "r", locking=False) as file:
        changed = ("strings", "checksums")
        found["attributes"] = {k: v for k, v in file.attrs.items() if k not in changed}
        for name, dataset in file.items():
            rows = dataset[:]
            if f"{name}_done" in file:
                done = file[f"{name}_done"][:] == 1
                found[name] = [(row, rows[row].tobytes()) for row in np.flatnonzero(done)]
            elif dataset.dtype.names:
                found[name] = rows.tobytes()
            attributes = {k: np.array(v).tolist() for k, v in dataset.attrs.items()}
            found[f"{name} is"] = attributes, dataset.id.get_type().encode()
    return found


@pytest.mark.parametrize("chunk_bytes", [compact.CHUNK_BYTES, 2000])
def test_a_copy_has_the_same_rows_attributes_and_types(filled, copy, monkeypatch, chunk_bytes):
    monkeypatch.setattr(compact, "CHUNK_BYTES", chunk_bytes)
    assert write_compact(filled, copy) == CopyCounts(strings=7, samples=36, damaged=0)
    assert contents(copy) == contents(filled)
    assert len(contents(copy)["samples"]) == 36


def test_a_copy_is_as_long_as_there_are_strings_and_smaller(filled, copy):
    with h5py.File(filled, "r+") as file:
        file["samples"][3] = file["samples"][1 * MAX_SAMPLES + 1]  # torn: without its done byte
    write_compact(filled, copy)
    with h5py.File(copy) as file:
        lengths = {name: len(dataset) for name, dataset in file.items()}
        assert file.attrs["strings"] == lengths["strings"] == lengths["results"] == 7
        assert lengths["samples"] == lengths["samples_done"] == 7 * MAX_SAMPLES
        assert (lengths["generations"], lengths["legs"], lengths["failures"]) == (3, 1, 1)
        assert all(dataset.compression == "gzip" for dataset in file.values())
        assert all(dataset.shuffle for dataset in file.values())
        assert file["samples"][3].tobytes().strip(b"\0") == file["samples"][3].tobytes()
        absent = file["samples"][:][file["samples_done"][:] == 0]
        assert not any(absent.tobytes()), "what is not final is not copied"
    assert copy.stat().st_size < filled.stat().st_size / 3
    assert copy.read_bytes()[8] == 0, "superblock version, the oldest"


def test_a_copy_of_an_empty_campaign_and_of_a_copy(path, tmp_path):
    assert write_compact(path, tmp_path / "a.h5") == CopyCounts(0, 0, 0)
    assert write_compact(tmp_path / "a.h5", tmp_path / "b.h5") == CopyCounts(0, 0, 0)
    assert contents(tmp_path / "b.h5") == contents(path)
    assert len(open_campaign(tmp_path / "b.h5").strings) == 0


def test_an_existing_file_is_not_overwritten(filled, copy):
    copy.write_text("precious")
    with pytest.raises(FileExistsError, match="exists already and is not overwritten"):
        write_compact(filled, copy)
    before = filled.read_bytes()
    with pytest.raises(FileExistsError):
        write_compact(filled, filled)
    assert (copy.read_text(), filled.read_bytes()) == ("precious", before)


def test_a_file_that_appears_meanwhile_is_not_overwritten(tmp_path):
    path = tmp_path / "a.csv"
    writing = whole.atomic_file(path)
    writing.__enter__().write_text("new")
    path.write_text("precious")
    with pytest.raises(FileExistsError):
        writing.__exit__(None, None, None)
    assert path.read_text() == "precious"
    assert os.listdir(tmp_path) == ["a.csv"]


def test_two_exports_to_one_name_do_not_mix(tmp_path):
    path = tmp_path / "a.csv"
    with whole.atomic_file(path) as temporary:
        temporary.write_text("first")
        with pytest.raises(OSError, match="written by another process"), whole.atomic_file(path):
            pass
    assert path.read_text() == "first"
    assert os.listdir(tmp_path) == ["a.csv"]


@pytest.mark.parametrize("missing", [1, 3000, 60_000, "all but 500"])
def test_a_full_disc_leaves_nothing_and_the_process_whole(
    filled, copy, file_size_limit, missing, tmp_path
):
    write_compact(filled, tmp_path / "good.h5")
    size = (tmp_path / "good.h5").stat().st_size
    file_size_limit(500 if missing == "all but 500" else size - missing)
    with pytest.raises(OSError, match=r"too large: '.*/copy\.h5'$"):
        write_compact(filled, copy)
    assert sorted(os.listdir(tmp_path)) == ["good.h5", filled.name]
    file_size_limit(size)
    write_compact(filled, copy)  # HDF5 crashed here after a failed write of its cache
    assert contents(copy) == contents(filled)


def test_a_copy_in_a_missing_directory_names_the_file(filled, tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere/copy\.h5"):
        write_compact(filled, tmp_path / "nowhere" / "copy.h5")


def test_damaged_rows_are_copied_as_they_are_and_counted(filled, copy, monkeypatch):
    monkeypatch.setattr(compact, "REWRITE_SECONDS", 0.0)
    with h5py.File(filled, "r+") as file:
        row = file["samples"][2]
        row["objective"] += 1
        file["samples"][2] = row
        file["results_done"][3] = 1
    lines = list(export(filled, Exports(copy)))
    assert lines[1] == f"{copy}: 2 damaged rows, copied unchanged"
    assert open_campaign(copy).damaged == 2
    assert contents(copy) == contents(filled)


def test_a_leg_that_is_just_rewritten_is_read_again(path, copy, monkeypatch):
    with CampaignWriter(path) as writer:
        leg = begin_leg(writer)
        legs = writer.log._legs.rows
        torn = legs.read(leg, 1)
        torn["samples"] = 5
        legs.write(leg, torn)
        end = {"stopped": 2e9, "exit_code": 0, "samples": 5, "busy_seconds": 1.0}
        end |= {"cpu_seconds": 0.9, "database_seconds": 0.1}
        monkeypatch.setattr(compact.time, "sleep", lambda seconds: writer.log.end_leg(leg, **end))
        assert write_compact(path, copy).damaged == 0
    assert read_campaign(copy).legs()["exit_code"].tolist() == [0]


def test_a_copy_of_a_growing_file_lacks_nothing_that_its_rows_rest_on(tmp_path, copy, monkeypatch):
    path = make(tmp_path / "growing.h5", generations=40)
    read = compact._read
    with CampaignWriter(path) as writer:

        def go_on(*arguments):
            number = len(read_campaign(path).generation_rows())
            put_strings(writer, number, 1)
            writer.put_samples(sample_rows(number, 0, 10))
            put_result(writer, number, 0.5, used=10)
            put_generation(writer, number)
            return read(*arguments)

        monkeypatch.setattr(compact, "_read", go_on)
        write_compact(path, copy)
    file = read_campaign(copy)
    strings, samples = file.string_rows(), file.all_sample_rows()
    results, generations = file.result_rows(), file.generation_rows()
    assert file.damaged == 0
    assert 0 < len(generations) <= len(results) <= len(strings) < len(open_campaign(path).strings)
    assert set(generations["generation"]) <= set(results["string"]) <= set(strings["string"])
    used = samples[np.isin(samples["string"], results["string"])]
    assert np.bincount(used["string"]).tolist() == [10] * len(results)


def test_a_copy_cannot_be_written_to(filled, copy):
    write_compact(filled, copy)
    before = copy.read_bytes()
    for touch in (CampaignWriter, lambda path: enlarge_campaign_file(path, table_room(100, 100))):
        with pytest.raises(NotACampaign, match=r"copy\.h5: a compact copy.*--output"):
            touch(copy)
    assert copy.read_bytes() == before


def test_a_source_with_an_unreadable_chunk_is_said_to_be_damaged(filled, copy, tmp_path):
    write_compact(filled, copy)
    with h5py.File(copy) as file:
        chunk = file["samples"].id.get_chunk_info(0)
    with open(copy, "r+b") as raw:
        raw.seek(chunk.byte_offset + chunk.size // 2)
        raw.write(b"\xff" * 20)
    with pytest.raises(NotACampaign, match=r"copy\.h5: a damaged .*/samples cannot be read$"):
        write_compact(copy, tmp_path / "again.h5")
    assert not (tmp_path / "again.h5").exists()


def run_and_kill(monkeypatch, job, when):
    """Run in a child that is killed before its so-many-th write, sync or rename; how many it did.

    Only a child that ends by itself says that number.
    """
    child = os.fork()
    if child == 0:
        count = 0

        def counted(function):
            def call(*arguments):
                nonlocal count
                count += 1
                if count == when:
                    os.kill(os.getpid(), signal.SIGKILL)
                return function(*arguments)

            return call

        try:
            monkeypatch.setattr(CheckedFile, "write", counted(CheckedFile.write))
            monkeypatch.setattr(os, "fsync", counted(os.fsync))
            monkeypatch.setattr(os, "replace", counted(os.replace))
            job()
            os._exit(count)
        finally:
            os._exit(255)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


JOBS = {
    "copy": (lambda source, to: write_compact(source, to / "copy.h5"), ["copy.h5"]),
    "csv": (
        lambda source, to: list(write_tables(read_campaign(source), to)),
        ["estimates.csv", "generations.csv", "samples.csv", "strings.csv"],
    ),
}


@pytest.mark.parametrize("kind", JOBS)
def test_a_kill_leaves_nothing_or_the_whole(filled, tmp_path, monkeypatch, kind):
    job, names = JOBS[kind]
    (tmp_path / "good").mkdir()
    total = run_and_kill(monkeypatch, lambda: job(filled, tmp_path / "good"), 0)
    assert 8 < total < 200
    assert sorted(os.listdir(tmp_path / "good")) == names
    seen = set()
    for when in {
        *range(1, total, 24 if kind == "copy" else 6),
        *range(max(1, total - 7), total + 1),
    }:
        to = tmp_path / f"killed {when}"
        to.mkdir()
        assert run_and_kill(monkeypatch, lambda to=to: job(filled, to), when) == -signal.SIGKILL
        shown = [name for name in os.listdir(to) if not name.startswith(".")]
        seen.add(len(shown))
        for name in shown:
            assert (to / name).read_bytes() == (tmp_path / "good" / name).read_bytes()
            (to / name).unlink()
        job(filled, to)
        assert sorted(os.listdir(to)) == names, "what a kill left behind is gone"
    assert seen == set(range(len(names) + 1))


def test_tables_read_back_bit_for_bit(filled, tmp_path):
    file = open_campaign(filled)
    odd = np.array([0.1, 1 / 3, 5e-324, -0.0, 1.7976931348623157e308, np.inf, 2**-1074 * 3])
    with CampaignWriter(filled) as writer:
        rows = sample_rows(6, 0, len(odd))
        rows["objective"], rows["energy_error"] = odd, np.nan
        rows["end_time"] = np.random.default_rng(1).random(len(odd)) * 1e-7
        writer.put_samples(rows)
    data = read_campaign(filled)
    data.with_unused = True  # as `file` counts them
    lines = list(write_tables(data, tmp_path / "new" / "tables"))
    assert lines[3] == f"{tmp_path}/new/tables/samples.csv: 43 rows"
    for name in ("strings", "samples", "generations"):
        table = getattr(file, name)
        path = tmp_path / "new" / "tables" / f"{name}.csv"
        back = pd.read_csv(path, keep_default_na=False)
        texts = pd.read_csv(path, dtype=str, keep_default_na=False)
        assert [title.partition(" (")[0] for title in back] == list(table.columns)
        for title, column in zip(back, table, strict=True):
            expected = table[column].to_numpy()
            if column == "population":
                assert back[title].tolist() == [" ".join(map(str, ids)) for ids in expected]
            elif expected.dtype == float:
                found = np.array([float(text) for text in texts[title]])
                assert found.tobytes() == expected.tobytes(), title
            else:
                assert back[title].tolist() == expected.tolist(), title


def test_titles_of_columns_have_their_units(filled, tmp_path):
    list(write_tables(read_campaign(filled), tmp_path))
    titles = (tmp_path / "strings.csv").read_text().splitlines()[0].split(",")
    assert {"hardness (Pa)", "density (kg/m^3)", "friction", "seconds (s)"} <= set(titles)
    titles = (tmp_path / "samples.csv").read_text().splitlines()[0].split(",")
    assert {"mean_temperature (K)", "collisions", "end_time (s)"} <= set(titles)


def test_strings_are_tabulated_when_one_of_them_is_damaged(path):
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 4)
        writer.put_samples(sample_rows(0, 0, 3))
    with h5py.File(path, "r+") as file:
        row = file["strings"][1]
        row["hardness"] += 1
        file["strings"][1] = row
    table = open_campaign(path).strings
    assert table["string"].tolist() == [0, 2, 3]
    assert table["seconds"].tolist() == [3.0, 0.0, 0.0]
