"""Campaign files that somebody has altered: one line, exit code 1, whatever is asked of them."""

import shutil

import h5py
import numpy as np
import pytest
from campaign_runs import invert

from agglom_mpi.analysis.damage import blame_damage
from agglom_mpi.storage.table import checksums

DEEP = "[" * 100_000
IDENTITIES = ["{", "[]", "5", "null", '"x"', "{}", DEEP, '{"seed": ' + "9" * 5000 + "}"]
NUMBERS = ("max_samples", "strings", "population")
TEXTS = ("campaign", "campaign_sha256", "code_version", "created", "sources_sha256", "title")
SLOW = pytest.mark.slow
COMMANDS = [
    pytest.param(["report"], id="report"),
    pytest.param(["check"], id="check", marks=SLOW),
]
OTHERS = [
    pytest.param(["report", "--json"], id="json"),
    pytest.param(["export", "--csv", "csv"], id="csv"),
    pytest.param(["export", "--compact", "copy.h5"], id="compact"),
    pytest.param(["simulate", "--string", 0, "--sample", 0], id="simulate"),
]


@pytest.fixture
def altered(tiny_folder, tmp_path):
    """Return a function that opens a copy of a campaign file to be altered; its path."""

    def alter(change):
        path = tmp_path / "altered.h5"
        shutil.copy(tiny_folder / "tiny.h5", path)
        with h5py.File(path, "r+") as file:
            change(file)
        return path

    return alter


@pytest.fixture(params=COMMANDS)
def refused(request, mistaken, tmp_path, monkeypatch):
    """Return a function that runs a command on a file; it must say in one line what is wrong."""

    def run(path):
        monkeypatch.chdir(tmp_path)
        name, *options = request.param
        said = mistaken(name, path, *options, code=1) if name != "check" else checked(path)
        assert not (tmp_path / "csv").exists()
        assert not (tmp_path / "copy.h5").exists()
        return said

    def checked(path):
        from agglom_mpi.analysis.file_check import check_file

        text, code = check_file(str(path))
        assert code == 1
        return text

    return run


def set_attribute(name, value):
    def change(file):
        file.attrs[name] = value

    return change


ALTERED = {
    **{f"identity {text[:12]}": ("identity", text) for text in IDENTITIES},
    **{f"{name} {value}": (name, value) for name in NUMBERS for value in (-1, 0, "abc", 2.5)},
    **{f"{name} 5": (name, 5) for name in TEXTS},
    "max_samples 2^62": ("max_samples", 2**62),
    "strings 2^62": ("strings", 2**62),
    "fresh_from": ("fresh_from", 10**9),
    "grains": ("grains", "many"),
    "frames": ("frames", 2**40),
    "seed": ("seed", "9" * 5000),
    "format_version": ("format_version", "abc"),
}


@pytest.mark.parametrize(("name", "value"), ALTERED.values(), ids=ALTERED)
def test_an_altered_attribute_is_damage(altered, refused, name, value):
    said = refused(altered(set_attribute(name, value)))
    assert "damaged campaign file" in said
    assert name in said or "shape" in said


@pytest.mark.parametrize("refused", OTHERS, indirect=True)
@pytest.mark.parametrize(("name", "value"), [("identity", "{"), ("max_samples", 0)])
def test_an_altered_attribute_is_damage_to_every_command(altered, refused, name, value):
    said = refused(altered(set_attribute(name, value)))
    assert "damaged campaign file" in said
    assert name in said or "shape" in said


@pytest.mark.parametrize("name", ["identity", "max_samples", "strings", *TEXTS])
def test_a_missing_attribute_is_damage(altered, refused, name):
    assert f"attribute {name} is no" in refused(altered(lambda file: file.attrs.pop(name)))


def declare(rows):
    """Return a change that declares a table of that many rows, of which none is stored."""

    def change(file):
        for name in ("samples", "samples_done"):
            dtype = file[name].dtype
            del file[name]
            file.create_dataset(name, (rows,), dtype, chunks=(1000,))
        file.attrs["max_samples"] = rows // int(file.attrs["strings"])

    return change


def test_a_table_larger_than_any_memory_is_damage(altered, mistaken):
    path = altered(declare(4 * 10**13))
    assert "damaged campaign file" in mistaken("report", path, code=1)


def test_other_variables_are_damage(altered, refused):
    def change(file):
        rows = file["variables"][...]
        rows["name"][0] = b"\xff\xfe"
        file["variables"][...] = rows

    assert "/variables has other names" in refused(altered(change))


def test_a_status_that_is_no_text_is_shown(altered, agglom):
    def change(file):
        rows = file["status"][...]
        rows["state"], rows["reason"] = b"\xff\xfe", b"\x1b[31mred\x07"
        rows["crc"] = checksums(rows)
        file["status"][...] = rows

    shown = agglom("report", altered(change))
    assert shown.exit_code == 0
    assert "\x1b[31m" not in shown.stdout
    assert "red" in shown.stdout


def test_escape_sequences_of_a_title_do_not_reach_the_terminal(altered, agglom):
    shown = agglom("report", altered(set_attribute("title", "\x1b]0;owned\x07\x1b[2Jgrains")))
    assert shown.exit_code == 1
    assert "grains" in shown.stdout
    assert not set(shown.stdout) & {"\x1b", "\x07"}


@pytest.mark.parametrize("options", [[], ["--json"], ["--out", "page", "--stored-only"]])
def test_a_report_says_that_damaged_rows_are_left_out(altered, agglom, tmp_path, options):
    def change(file):
        row = file["samples"][0]
        row["mean_radius_ratio"] += 1.0
        assert checksums(np.array([row])) != row["crc"]
        file["samples"][0] = row

    path = altered(change)
    options = [tmp_path / option if option == "page" else option for option in options]
    done = agglom("report", path, *options)
    assert done.exit_code == 1
    assert f"1 damaged row left out; agglom check {path}" in done.stderr
    assert done.stdout


def column(table, name, value):
    """Return a change of a column of a table, together with its checksums."""

    def change(file):
        rows = file[table][:20]
        rows[name] = value
        if "crc" in rows.dtype.names:
            rows["crc"] = checksums(rows)
        file[table][: len(rows)] = rows

    return change


def no_utf8(name):
    def change(file):
        del file.attrs[name]
        file.attrs.create(name, b"\xff\xfe", dtype=h5py.string_dtype())

    return change


@pytest.mark.parametrize("name", ["title", "campaign", "purpose"])
def test_an_attribute_that_is_no_utf8_is_damage(altered, refused, name):
    assert f"attribute {name} is no text" in refused(altered(no_utf8(name)))


@pytest.mark.parametrize("table", ["variables", "status", "generations", "legs"])
def test_a_table_of_rows_that_are_not_in_the_file_is_damage(altered, refused, table):
    def change(file):
        for name in {table, f"{table}_done"} & set(file):
            dtype = file[name].dtype
            del file[name]
            file.create_dataset(name, (10**9,), dtype, chunks=(64,))

    assert f"/{table} has" in refused(altered(change))


@pytest.mark.parametrize("searched", [0, 1])
def test_a_searched_variable_without_a_range_is_damage(altered, refused, searched):
    said = refused(altered(column("variables", "searched", searched)))
    assert "/variables has a searched variable without a range" in said


def test_rows_that_contradict_each_other_are_damage(altered, mistaken, tmp_path, monkeypatch):
    path = altered(column("results", "string", 0))
    monkeypatch.chdir(tmp_path)
    said = mistaken("export", path, "--csv", "csv", code=1)
    assert f"{path}: a damaged campaign file; agglom check {path}" in said


def test_an_error_with_a_sound_file_is_shown_as_it_is(tiny_folder):
    with pytest.raises(ZeroDivisionError), blame_damage(tiny_folder / "tiny.h5"):
        raise ZeroDivisionError


def test_a_leg_at_no_date_is_shown(altered, agglom, tmp_path):
    path = altered(column("legs", "started", 1e300))
    shown = agglom("report", path, "--out", tmp_path / "page", "--stored-only")
    assert shown.exit_code == 0
    assert "no date" in (tmp_path / "page" / "report.html").read_text()


def test_a_run_does_not_continue_with_rows_that_contradict_each_other(altered, tiny_folder):
    def without_results(file):
        column("samples", "particles", 0)(file)
        file["results_done"][:] = 0
        file["generations_done"][:] = 0

    path = altered(without_results)
    done = invert(tiny_folder, "tiny.yaml", "-o", path)
    assert done.returncode == 1
    assert f"{path}: a damaged campaign file" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_run_does_not_continue_with_another_first_fresh_sample(altered, tiny_folder):
    path = altered(set_attribute("fresh_from", 0))
    done = invert(tiny_folder, "tiny.yaml", "-o", path)
    assert done.returncode == 1
    assert "fresh_from" in done.stderr


def same_length(file):
    text = file.attrs["campaign"]
    file.attrs["campaign"] = text.replace("seed", "sead")


def widen(file):
    rows = file["variables"][...]
    rows["upper"][rows["searched"] == 1] *= 2.0
    file["variables"][...] = rows


UNNOTICED = {
    "campaign": same_length,
    "title": set_attribute("title", "another"),
    "created": set_attribute("created", "2020-01-01T00:00:00+00:00"),
    "fresh_from": lambda file: file.attrs.pop("fresh_from"),
    "/variables": widen,
}


@pytest.mark.parametrize(("name", "change"), UNNOTICED.items(), ids=UNNOTICED)
def test_what_check_refuses_a_report_names_and_a_run_refuses(
    altered, agglom, tiny_folder, caplog, name, change
):
    path = altered(change)
    found = agglom("check", path)
    assert found.exit_code == 1
    shown = agglom("report", path)
    assert shown.exit_code == 1
    assert name in found.stdout + caplog.messages[0]
    done = invert(tiny_folder, "tiny.yaml", "-o", path)
    assert done.returncode == 1
    assert name in done.stderr
