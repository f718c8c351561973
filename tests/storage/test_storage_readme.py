"""The description of the file format says what is in a file: no more, no less."""

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from storage_rows import POPULATION, make, put_strings, sample_rows

import agglom_mpi.storage
from agglom_mpi.outcome import REASONS
from agglom_mpi.storage.compact import write_compact
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.writer import CampaignWriter

GRAINS = 7
FOLDER = Path(agglom_mpi.storage.__file__).parent
TEXT = (FOLDER / "TABLES.md").read_text()
README = (FOLDER / "README.md").read_text()


def tables(part: str) -> list[list[list[str]]]:
    """Cells of each markdown table in a part of the text, without code marks and headers."""
    found, rows = [], []
    for line in [*part.splitlines(), ""]:
        if line.startswith("|"):
            cells = re.split(r"(?<!\\)\|", line)[1:-1]
            rows.append([re.sub(r"`|\\(?=\|)", "", cell).strip() for cell in cells])
        elif rows:
            found.append(rows[2:])
            rows = []
    return found


def section(title: str) -> str:
    """Text between a heading and the next one."""
    return re.split(r"\n#+ ", TEXT.partition(f" {title}\n")[2])[0]


@pytest.fixture(params=["as written", "compact"])
def file(tmp_path, request):
    path = make(tmp_path / "all.h5", grains=GRAINS, final_particles=True, frames=4)
    if request.param == "compact":
        write_compact(path, tmp_path / "compact.h5")
        path = tmp_path / "compact.h5"
    with h5py.File(path, "r", locking=False) as file:
        yield file


def type_of(dtype: np.dtype) -> str:
    """Write a type as in the text."""
    sizes = {2: "2", 3: "3", POPULATION: "population", GRAINS: "grains"}
    times = "".join(f" × {sizes[size]}" for size in dtype.shape)
    return dtype.base.str.lstrip("<|") + times


def test_the_attributes_of_the_file_are_described(file):
    described = [(name, kind) for name, kind, _ in tables(section("Attributes"))[0]]
    kinds = {str: "text", np.int64: "i8"}
    assert sorted(described) == sorted((n, kinds[type(v)]) for n, v in file.attrs.items())


def test_the_attributes_of_the_datasets_are_described(file):
    _, of_tables, of_done_bytes = tables(section("Attributes"))
    for dataset in file.values():
        described = of_tables if dataset.dtype.names else of_done_bytes
        assert {name for name, _ in described} == set(dataset.attrs)


def test_every_dataset_is_described_by_its_own_words(file):
    (overview,) = tables(section("Datasets"))
    described = [(name, row, meaning) for name, row, _, meaning in overview]
    assert sorted(described) == sorted(
        (dataset.name, dataset.attrs["row"], dataset.attrs["meaning"]) for dataset in file.values()
    )


def test_every_column_is_described_by_its_own_words(file):
    titles = set(re.findall(r"\n### `/(.*)`\n", TEXT))
    assert titles == {name for name, dataset in file.items() if dataset.dtype.names}
    for name in titles:
        table = file[name]
        columns = [
            [column, type_of(table.dtype[column]), unit, meaning.replace("`", "")]
            for column, unit, meaning in zip(
                table.dtype.names,
                table.attrs["field_units"],
                table.attrs["field_meanings"],
                strict=True,
            )
        ]
        assert tables(section(f"`/{name}`"))[0] == columns
        packed = [(column, table.dtype[column]) for column in table.dtype.names]
        assert table.dtype == np.dtype(packed)


def test_done_bytes_are_bytes(file):
    assert {d.dtype for d in file.values() if not d.dtype.names} == {np.dtype("u1")}


def test_the_reasons_of_failures_are_listed():
    listed = tables(section("`/samples`"))[1]
    assert listed == [[str(code), text] for code, text in enumerate(REASONS) if code]


def test_the_lines_for_reading_without_this_package_read_what_it_reads(path):
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 5)
        put_strings(writer, 8, 2)  # of a coming generation
        for string in (1, 3, 9):
            writer.put_samples(sample_rows(string, string, 7))
    with h5py.File(path, "r+") as file:
        row = file["samples"][305]
        row["objective"] += 1
        file["samples"][305] = row
    (lines,) = re.findall(r"```python\n(import zlib.*?)```", README, re.S)
    found = {}
    exec(lines.replace("accretion_2003.h5", str(path)), found)
    campaign = read_campaign(path)
    assert len(found["samples"]) == 20
    assert found["samples"].tobytes() == campaign.all_sample_rows().tobytes()
    assert found["strings"].tobytes() == campaign.string_rows().tobytes()
