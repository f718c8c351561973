"""`agglom compare`: laws compared on the terminal, as JSON, and what is refused."""

import importlib.util
import json
import shutil

import pytest

from agglom_mpi import compare_laws, open_campaign
from agglom_mpi.inference import law_comparison, next_measurement
from agglom_mpi.inference.data_calibration import DataCalibration


@pytest.fixture
def files(measured_file, tmp_path, monkeypatch, remembered):
    """Return a file with data, twice, whose few strings are taken to suffice."""
    monkeypatch.setattr("agglom_mpi.inference.stored_samples.MIN_STRINGS", 5)
    monkeypatch.setattr(DataCalibration, "passed", True)
    # A law fits, whatever its few samples are; repetitions need no further emulators.
    monkeypatch.setattr(law_comparison, "UNLIKELY", 0.0)
    monkeypatch.setattr(next_measurement, "_new_quantities", lambda *_: ())
    other = tmp_path / "other.h5"
    shutil.copy(measured_file, other)
    return measured_file, other


def test_json_has_the_laws_the_verdict_and_the_datum_that_decides(agglom, files):
    done = agglom("compare", *files, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert [row["law"] for row in found["laws"]] == ["measured", "other"]
    for row in found["laws"]:
        assert row["probability"] == pytest.approx(0.5)
        assert row["log_evidence_error"] > 0.0
        assert row["effective_size"] > 200.0
        assert 0.0 <= row["p_value"] <= 1.0
        assert len(row["variables_inside"]) + len(row["variables_open_ended"]) == 2
    assert found["decided"] is False
    has_arviz = importlib.util.find_spec("arviz") is not None
    assert (found["deciding"] is not None) == has_arviz
    assert found["deciding_experiment"] is None
    # No repetition tells a law from itself.
    assert len(found["next_measurements"]) == 3
    for row in found["next_measurements"]:
        assert row["repeats"]
        assert row["expected_probability"] == pytest.approx(0.5)
        assert row["expected_log_bayes_factor"] == pytest.approx(0.0, abs=1e-9)
    same = compare_laws([open_campaign(files[0]), files[1]])
    assert same.as_dict()["verdict"] == found["verdict"]
    assert list(same.table["law"]) == ["measured", "other"]


def test_the_terminal_has_a_row_for_each_law_below_the_verdict(agglom, files):
    done = agglom("compare", *files)
    assert done.exit_code == 0, done.output
    verdict, heading, *rows = done.stdout.splitlines()
    assert verdict.startswith("not decided")
    assert heading.startswith("law")
    assert [row.split()[0] for row in rows[:2]] == ["measured", "other"]
    assert "±" in rows[0]
    assert sum(", again" in row for row in rows) == 3


def test_without_arviz_the_columns_are_absent_and_the_extra_is_named(agglom, files, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "arviz" else find(name)
    )
    done = agglom("compare", *files, "--json")
    found = json.loads(done.stdout)
    assert found["deciding"] is None
    assert not any("left_out" in key for row in found["laws"] for key in row)
    assert "agglom_mpi[arviz]" in agglom("compare", *files).stdout


def test_files_that_cannot_be_compared_are_refused_in_one_line(
    mistaken, agglom, files, tiny_folder, monkeypatch
):
    assert agglom("compare", files[0]).exit_code == 2
    assert "objective" in mistaken("compare", files[0], tiny_folder / "tiny.h5")
    monkeypatch.setattr(DataCalibration, "passed", False)
    assert str(files[0]) in mistaken("compare", *files)
