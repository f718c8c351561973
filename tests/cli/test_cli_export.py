"""`agglom export`: a copy that answers as the original does, and tables as text."""

import importlib.util
import json
import os
import subprocess

import h5py
import numpy as np
import pandas as pd
import pytest
from campaign_runs import decisions, environment, invert
from processes import HANG

from agglom_mpi import open_campaign
from agglom_mpi.formatting import pluralise
from agglom_mpi.storage.reader import read_campaign


@pytest.fixture
def copy(agglom, tmp_path):
    """Return a compact copy of the tiny campaign's file."""
    done = agglom("export", "tiny.h5", "--compact", tmp_path / "copy.h5")
    assert done.exit_code == 0, done.stderr
    return tmp_path / "copy.h5"


def test_a_copy_has_the_same_results_and_tables(copy, tiny_folder):
    assert decisions(copy) == decisions(tiny_folder / "tiny.h5")
    old, new = open_campaign(tiny_folder / "tiny.h5"), open_campaign(copy)
    for table in ("strings", "samples", "generations", "variables"):
        pd.testing.assert_frame_equal(getattr(new, table), getattr(old, table))
    pd.testing.assert_frame_equal(new.best(3), old.best(3))
    assert new.status() == old.status()
    legs = [read_campaign(file.path).legs().tobytes() for file in (old, new)]
    assert legs[0] == legs[1]
    assert new.damaged == 0


def test_a_copy_is_smaller_and_says_so(agglom, tmp_path):
    done = agglom("export", "tiny.h5", "--compact", tmp_path / "copy.h5")
    copy, original = os.stat(tmp_path / "copy.h5"), os.stat("tiny.h5")
    assert copy.st_size < original.st_size / 10
    megabytes = [f"{size / 1e6:.3g} MB" for size in (copy.st_size, 512 * original.st_blocks)]
    samples = len(read_campaign("tiny.h5").all_sample_rows())
    expected = f"copy.h5: 4 strings, {samples} samples, {' of '.join(megabytes)} on disc\n"
    assert done.stdout.endswith(expected)
    assert done.stderr == ""


def test_the_report_of_a_copy_is_that_of_the_original(agglom, copy):
    old, new = (json.loads(agglom("report", p, "--json").stdout) for p in ("tiny.h5", copy))
    assert new.pop("file") == str(copy)
    assert old.pop("file") == "tiny.h5"
    assert new == old
    shown = [agglom("report", path).stdout.splitlines()[:-1] for path in ("tiny.h5", copy)]
    assert shown[0][:-2] == shown[1][: len(shown[0]) - 2]


def test_a_sample_of_a_copy_is_replayed(agglom, copy):
    done = agglom("simulate", copy, "--string", 2, "--sample", 1)
    assert done.exit_code == 0
    assert done.stdout.endswith("identical to the recorded sample\n")


def test_a_run_does_not_continue_a_copy(tiny_folder, copy):
    before = copy.read_bytes()
    done = invert(tiny_folder, "tiny.yaml", "-q", "-o", copy)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "copy.h5: a compact copy, which can be read but not continued" in done.stderr
    assert "--output" in done.stderr
    assert copy.read_bytes() == before


def test_tables_read_back_bit_for_bit(agglom, tmp_path):
    done = agglom("export", "tiny.h5", "--csv", tmp_path / "tables")
    assert done.exit_code == 0, done.stderr
    names = ["estimates", "generations", "samples", "strings"]
    assert sorted(os.listdir(tmp_path / "tables")) == [f"{name}.csv" for name in names]
    for name in names:
        table = getattr(open_campaign("tiny.h5"), name)
        assert f"{name}.csv: {pluralise(len(table), 'row')}\n" in done.stdout
        path = tmp_path / "tables" / f"{name}.csv"
        back = pd.read_csv(path)
        texts = pd.read_csv(path, dtype=str, keep_default_na=False)
        units = table.attrs["units"]
        for title, column in zip(back, table, strict=True):
            unit = units[column] if units[column] != "1" else ""
            assert title == (f"{column} ({unit})" if unit else column)
            if table[column].dtype == float:
                found = np.array([float(text) for text in texts[title]])
                assert found.tobytes() == table[column].to_numpy().tobytes(), title
            elif table[column].dtype.kind in "bi":
                assert np.array_equal(back[title], table[column])
    population = pd.read_csv(path.with_name("generations.csv"))["population"][0]
    best = open_campaign("tiny.h5").best(1)["string"][0]
    assert int(population.split()[0]) == best


def test_both_at_once(agglom, tmp_path):
    done = agglom("export", "tiny.h5", "--csv", tmp_path, "--compact", tmp_path / "c.h5")
    assert done.exit_code == 0
    assert len(done.stdout.splitlines()) == 5
    assert len(os.listdir(tmp_path)) == 5


def test_one_of_all_must_be_given(agglom):
    done = agglom("export", "tiny.h5")
    assert done.exit_code == 2
    for option in ("--compact", "--csv", "--xarray", "--arviz", "--emulator", "--paraview"):
        assert option in done.stderr


def test_nothing_is_overwritten_and_nothing_written_before_that_is_known(mistaken, tmp_path):
    (tmp_path / "samples.csv").write_text("precious")
    words = ["export", "tiny.h5", "--compact", tmp_path / "copy.h5", "--csv", tmp_path]
    assert mistaken(*words) == f"{tmp_path}/samples.csv: exists already and is not overwritten"
    assert os.listdir(tmp_path) == ["samples.csv"]
    (tmp_path / "copy.h5").touch()
    assert mistaken(*words) == f"{tmp_path}/copy.h5: exists already and is not overwritten"
    said = mistaken("export", "tiny.h5", "--compact", "tiny.h5")
    assert said == "tiny.h5: exists already and is not overwritten"
    assert (tmp_path / "samples.csv").read_text() == "precious"


@pytest.mark.parametrize("option", ["--compact", "--csv"])
def test_a_source_that_is_no_campaign_is_one_message(mistaken, tiny_folder, tmp_path, option):
    (tmp_path / "text.h5").write_text("no database")
    whole = (tiny_folder / "tiny.h5").read_bytes()
    (tmp_path / "short.h5").write_bytes(whole[: len(whole) // 2])
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1

    def said(source, code=2):
        return mistaken("export", source, option, tmp_path / "out", code=code)

    assert said("nothing.h5") == "nothing.h5: No such file or directory"
    assert said(tmp_path / "text.h5").endswith("text.h5: not an HDF5 file")
    assert said(tmp_path / "short.h5", code=1).endswith("short.h5: a truncated HDF5 file")
    assert said(tmp_path / "other.h5").endswith("not an agglom_mpi campaign")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("option", ["--compact", "--csv"])
def test_a_copy_with_a_damaged_chunk_is_one_message(mistaken, copy, option):
    with h5py.File(copy) as file:
        chunk = file["samples"].id.get_chunk_info(0)
    with open(copy, "r+b") as raw:
        raw.seek(chunk.byte_offset + chunk.size // 2)
        raw.write(b"\xff" * 20)
    said = mistaken("export", copy, option, copy.with_name("out"), code=1)
    assert said.startswith(str(copy))


def test_a_target_that_cannot_be_written_is_one_message(mistaken, tmp_path):
    (tmp_path / "file").touch()
    assert mistaken("export", "tiny.h5", "--csv", tmp_path / "file").endswith(
        "file: is no directory"
    )
    said = mistaken("export", "tiny.h5", "--compact", tmp_path / "nowhere" / "c.h5")
    assert said == f"{tmp_path}/nowhere/c.h5: No such file or directory"


@pytest.mark.parametrize("blocks", [4, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 8))])
def test_a_full_disc_is_one_message(tiny_folder, tmp_path, blocks):
    words = ["agglom", "export", "tiny.h5", "--compact", str(tmp_path / "copy.h5")]
    done = subprocess.run(
        ["bash", "-c", f"ulimit -f {blocks}; exec {' '.join(words)}"],
        cwd=tiny_folder,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
    )
    assert (done.returncode, done.stderr) == (2, f"{tmp_path}/copy.h5: File too large\n")
    assert os.listdir(tmp_path) == []


def test_without_pandas_it_says_what_to_install_and_writes_nothing(
    mistaken, agglom, tmp_path, monkeypatch
):
    find = importlib.util.find_spec
    without = lambda name, *rest: None if name == "pandas" else find(name, *rest)  # noqa: E731
    monkeypatch.setattr(importlib.util, "find_spec", without)
    said = mistaken("export", "tiny.h5", "--csv", tmp_path, "--compact", tmp_path / "c.h5")
    assert said == "tables need pandas: pip install 'agglom_mpi[report]'"
    assert os.listdir(tmp_path) == []
    assert agglom("export", "tiny.h5", "--compact", tmp_path / "c.h5").exit_code == 0
