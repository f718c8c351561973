"""`agglom check FILE.h5`: what is sound, what is damaged, and what a resume would compute again."""

import shutil

import h5py
import numpy as np
import pytest
from campaign_runs import assert_same, decisions, finish, invert
from storage_rows import put_status, table_room

from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.storage.compact import write_compact
from agglom_mpi.storage.create import enlarge_campaign_file
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.schema import FORMAT_VERSION
from agglom_mpi.storage.table import Table

TABLES = ("strings", "results", "samples", "generations")
AGAIN = {
    "strings": "propose again strings {0}",
    "results": "recompute the results of strings {0}",
    "samples": "simulate again sample {1} of string {0}",
    "generations": "repeat the decisions of generations {0}",
}


@pytest.fixture(scope="session")
def searched(shared_campaign):
    """Return the finished file of a small campaign of three generations."""
    return shared_campaign("small") / "small.h5"


@pytest.fixture
def copy(searched, tmp_path):
    shutil.copy(searched, tmp_path / "copy.h5")
    shutil.copy(searched.with_suffix(".yaml"), tmp_path / "small.yaml")
    return tmp_path / "copy.h5"


def places(path, table):
    """Offsets of all final rows of a table and of their done bytes, size of a row, and numbers."""
    with h5py.File(path, "r") as file:
        final = np.flatnonzero(file[f"{table}_done"][:])
        size = file[table].dtype.itemsize
        first, done = (file[name].id.get_offset() for name in (table, f"{table}_done"))
        most = int(file.attrs["max_samples"])
    numbers = [divmod(row, most) if table == "samples" else (row,) for row in final.tolist()]
    return (first + final * size).tolist(), (done + final).tolist(), size, numbers


def flip(path, offset, bits):
    with path.open("r+b") as file:
        file.seek(offset)
        byte = file.read(1)[0]
        file.seek(offset)
        file.write(bytes([byte ^ bits]))


def forge(path, table, number, **changes):
    """Change a row together with its checksum; a change that is a function gets the old value."""
    with h5py.File(path, "r+") as file:
        opened = Table(file, table, path)
        row = opened.rows.read(number, 1)
        for name, value in changes.items():
            row[name] = value(row[name]) if callable(value) else value
        opened.write(number, row)


def lines(path, code):
    text, found = check_file(str(path))
    assert found == code, text
    return text.splitlines()


def test_a_sound_file_is_said_to_be_and_left_as_it_is(agglom, copy):
    before = copy.read_bytes(), copy.stat().st_mtime_ns
    done = agglom("check", copy)
    assert (done.exit_code, done.stderr) == (0, "")
    assert (copy.read_bytes(), copy.stat().st_mtime_ns) == before
    file = read_campaign(copy)
    strings, used = len(file.string_rows()), file.result_rows()["samples_used"].sum()
    assert done.stdout.splitlines() == [
        f"{copy}: sound",
        f"  checksums: {strings} strings, {strings} results, 3 generations, "
        f"{len(file.all_sample_rows())} samples ({used} used), 1 leg and 0 failures are valid",
        "  digests: 3 of 3 generations verified",
        f"  replay: the samples lead again to {strings} of {strings} strings, {strings} of "
        f"{strings} results and 3 of 3 populations",
        "  finished: all 3 generations are done",
    ]


def test_a_compact_copy_is_as_sound_as_its_original(copy):
    write_compact(copy, copy.with_name("compact.h5"))
    assert lines(copy.with_name("compact.h5"), 0)[1:] == lines(copy, 0)[1:]


def test_a_compact_copy_of_a_stopped_campaign_is_sound_too(copy):
    with h5py.File(copy, "r+") as file:  # as if it had been stopped in the last generation
        last, most = int(file["results"]["string"].max()), int(file.attrs["max_samples"])
        file["generations_done"][2] = file["results_done"][last] = 0
        file["samples_done"][last * most : (last + 1) * most] = 0
        put_status(file, state=b"stopped")
        stored = int(np.count_nonzero(file["samples_done"][:]))
    forge(copy, "legs", 0, exit_code=75, samples=stored)
    write_compact(copy, copy.with_name("compact.h5"))
    text = lines(copy.with_name("compact.h5"), 0)
    assert f"lead again to {last + 1} of {last + 1} strings, {last} of {last} results" in text[3]
    assert text[1:] == lines(copy, 0)[1:]


def test_a_newer_format_version_is_refused_by_all_commands(mistaken, copy):
    with h5py.File(copy, "r+") as file:
        file.attrs["format_version"] = FORMAT_VERSION + 1
    before = copy.read_bytes()
    said = (
        f"{copy}: has format version {FORMAT_VERSION + 1}, and this program reads versions up to "
        f"{FORMAT_VERSION}: update "
    )
    target = copy.with_name("out")
    for words in (["check"], ["report"], ["export", "--compact", target]):
        assert mistaken(*words, copy) == said + "agglom_mpi"
    done = invert(copy.parent, "small.yaml", "-o", copy.name)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.endswith(f"{said.removeprefix(f'{copy.parent}/')}agglom_mpi\n")
    assert copy.read_bytes() == before


@pytest.mark.parametrize("flips", [5, pytest.param(60, marks=pytest.mark.slow)])
@pytest.mark.parametrize("table", TABLES)
def test_any_flipped_byte_of_a_final_row_is_found(tiny_folder, tmp_path, table, flips):
    path = tmp_path / "flipped.h5"
    shutil.copy(tiny_folder / "tiny.h5", path)
    rows, _, size, numbers = places(path, table)
    chance = np.random.default_rng(1984)
    chosen = chance.permutation([(i, at) for i in range(len(rows)) for at in range(size)])[:flips]
    for i, at in chosen.tolist():
        bits = int(chance.integers(1, 256))
        flip(path, rows[i] + at, bits)
        text = "\n".join(lines(path, 1))
        assert " with a wrong checksum\n" in text
        assert f"a resume would {AGAIN[table].format(*numbers[i])}" in text
        flip(path, rows[i] + at, bits)
    lines(path, 0)


@pytest.mark.parametrize("table", TABLES)
def test_any_flipped_done_byte_is_found(tiny_folder, tmp_path, table):
    path = tmp_path / "flipped.h5"
    shutil.copy(tiny_folder / "tiny.h5", path)
    _, done, _, numbers = places(path, table)
    for i in sorted({0, len(done) // 2, len(done) - 1}):
        offset, number = done[i], numbers[i]
        for bits in (1, 0x80):
            flip(path, offset, bits)
            text = "\n".join(lines(path, 1))
            if bits == 1:
                assert f"  {table}: " in text
                assert " absent, though " in text
                assert f"a resume would {AGAIN[table].format(*number)}" in text
            else:
                assert f"{table}_done: neither 0 nor 1 for " in text
            flip(path, offset, bits)
    lines(path, 0)


@pytest.mark.parametrize("table", TABLES)
def test_a_done_byte_that_is_set_without_a_row_is_found(copy, table):
    enlarge_campaign_file(copy, table_room(40, 9))
    lines(copy, 0)
    with h5py.File(copy, "r+") as file:
        absent = np.flatnonzero(file[f"{table}_done"][:] == 0)[0]
        file[f"{table}_done"][absent] = 1
    assert " with a wrong checksum\n" in "\n".join(lines(copy, 1))


def test_a_torn_row_with_its_done_byte_set_is_found_and_computed_again(searched, copy):
    with h5py.File(copy, "r+") as file:
        most, size = int(file.attrs["max_samples"]), file["samples"].dtype.itemsize
        start = file["samples"].id.get_offset() + (7 * most + 1) * size
    with copy.open("r+b") as file:
        file.seek(start + size // 2)
        file.write(bytes(size - size // 2))
    text = "\n".join(lines(copy, 1))
    assert "samples: sample 1 of string 7 with a wrong checksum" in text
    assert "a resume would simulate again sample 1 of string 7\n" in text
    finish(copy.parent, "small.yaml", "-q", "-o", copy.name)
    lines(copy, 0)
    assert_same(copy, decisions(searched))


def test_what_is_said_to_be_computed_again_is_and_the_file_is_sound_afterwards(searched, copy):
    wanted = decisions(searched)
    with h5py.File(copy, "r+") as file:
        most = int(file.attrs["max_samples"])
        for table, number in (("strings", 17), ("results", 5), ("samples", 3 * most + 1)):
            file[f"{table}_done"][number] = 0
        row = file["generations"][1]
        row["best_objective"] += 1.0
        file["generations"][1] = row
        row = file["samples"][20 * most]
        row["merges"] += 1
        file["samples"][20 * most] = row
    text = "\n".join(lines(copy, 1))
    assert (
        "a resume would propose again strings 17, simulate again sample 1 of string 3, sample 0 of "
        "string 20, recompute the results of strings 5, repeat the decisions of generations 1\n"
    ) in text
    assert "trusts every row" not in text
    finish(copy.parent, "small.yaml", "-q", "-o", copy.name)
    lines(copy, 0)
    assert_same(copy, wanted)


def test_a_damaged_sample_that_nothing_rests_on_is_said_to_be_unused(copy):
    file = read_campaign(copy)
    most, simulated = file.max_samples, len(file.all_sample_rows())
    there = set(file.all_sample_rows()[["string", "sample"]].tolist())
    used = file.result_rows()[["string", "samples_used"]].tolist()
    # One that no rank simulated ahead of the decision.
    unused = ((string, sample) for string, first in used for sample in range(first, most))
    string, sample = next(key for key in unused if key not in there)
    with h5py.File(copy, "r+") as opened:
        samples = Table(opened, "samples", copy)
        row = samples.rows.read(string * most, 1)
        row["sample"] = sample
        samples.write(string * most + sample, row)
    assert f"legs: simulated {simulated} samples in all, but {simulated + 1}" in lines(copy, 1)[1]
    forge(copy, "legs", 0, samples=simulated + 1)
    lines(copy, 0)
    with h5py.File(copy, "r+") as opened:
        row = opened["samples"][string * most + sample]
        row["merges"] += 1
        opened["samples"][string * most + sample] = row
    text = "\n".join(lines(copy, 1))
    assert f"no result rests on sample {sample} of string {string}: only computed again if" in text
    assert "a resume would" not in text
    assert "digests: 3 of 3 generations" in text


def slightly_more(old):  # too little to change how many samples are needed
    return 1.000001 * old


FORGERIES = [
    (
        "samples",
        0,
        {"mean_radius_ratio": lambda old: 1.000001 * old},
        "the samples give other results of strings 0",
    ),
    ("samples", 0, {"largest_residual": 0.5}, "generations: digest mismatch in 0:"),
    ("samples", 0, {"state": 7}, "samples: unknown state in sample 0 of string 0"),
    ("samples", 0, {"reason": 3}, "samples: reason of failure in sample 0 of string 0"),
    ("samples", 0, {"sample": 1}, "samples: numbers of another row in sample 0 of string 0"),
    ("strings", 14, {"density": 6e3}, "the search proposes other strings than 14"),
    ("strings", 14, {"slot": 0}, "the search proposes other strings than 14"),
    ("strings", 14, {"parents": [[3, 14]]}, "strings: parents that were not there yet in 14"),
    ("strings", 14, {"origin": 9}, "strings: unknown origin in 14"),
    ("results", 2, {"growth_number": 1.0}, "generations: digest mismatch in 0:"),
    ("results", 2, {"objective": 9.0}, "the samples give other results of strings 2"),
    ("results", 2, {"failed": 1}, "results: number of failed samples in 2"),
    ("results", 2, {"samples_used": 0}, "results: number of samples used in 2"),
    ("results", 2, {"samples_used": 31}, "results: number of samples used in 2"),
    ("generations", 1, {"digest": 1}, "generations: digest mismatch in 1:"),
    ("generations", 1, {"evaluations": 1}, "number of strings judged in 1 does not follow"),
    ("generations", 1, {"samples_used": 1}, "number of samples used in 1 does not follow"),
    ("generations", 1, {"best_string": 0}, "best string in 1 does not follow"),
    ("generations", 1, {"mean_of_top": 0.5}, "the search ends otherwise in generations 1"),
    ("generations", 1, {"population": [range(12)]}, "order of the population in 1 does not"),
    ("generations", 1, {"population": [range(90, 102)]}, "strings of the population in 1 does"),
    ("generations", 2, {"samples_simulated": 10**6}, "unused ones are absent; 1000000 had been"),
    ("legs", 0, {"ranks": 0}, "legs: impossible numbers in 0"),
]


@pytest.mark.parametrize(("table", "number", "changes", "expected"), FORGERIES)
def test_a_row_that_was_forged_with_its_checksum_is_found(copy, table, number, changes, expected):
    forge(copy, table, number, **changes)
    text = "\n".join(lines(copy, 1))
    assert expected in text
    assert "a resume trusts every row with a right checksum and repairs nothing else" in text


def test_another_order_of_equal_worth_is_found_by_the_replay(copy):
    population = read_campaign(copy).generation_rows()["population"][2].copy()
    forge(copy, "generations", 2, population=[np.roll(population, 1)])
    text = "\n".join(lines(copy, 1))
    assert "the search ends otherwise in generations 2" in text


@pytest.mark.parametrize("table", ["legs", "failures"])
def test_a_damaged_row_that_no_resume_makes_again_is_said_to_stay(copy, table):
    if table == "failures":
        forge(copy, table, 0, text=b"no error")
    flip(copy, places(copy, table)[0][0] + 3, 1)
    text = "\n".join(lines(copy, 1))
    assert f"{table}: 0 with a wrong checksum\n" in text
    assert "repairs nothing else" in text


@pytest.mark.parametrize(
    ("table", "column", "value", "expected"),
    [
        ("variables", "lower", 0.2, "variables: another box than in the campaign's text"),
        ("variables", "name", b"velocity", "/variables has other names or units"),
        ("status", "state", b"runny", "status: unknown state 'runny'"),
    ],
)
def test_a_changed_table_without_checksums_is_found(copy, table, column, value, expected):
    with h5py.File(copy, "r+") as file:
        row = file[table][0]
        row[column] = value
        file[table][0] = row
    assert expected in "\n".join(lines(copy, 1))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("seed: 1", "seed: 2", "campaign: the text in the file is not that of its identity"),
        ("population: 12", "population: x", "replay: not possible: "),
    ],
)
def test_another_campaign_text_is_found(copy, old, new, expected):
    with h5py.File(copy, "r+") as file:
        text = file.attrs["campaign"]
        assert text.count(old) == 1
        file.attrs["campaign"] = text.replace(old, new)
    assert expected in "\n".join(lines(copy, 1))


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("purpose", "inversiom", "attributes: unknown purpose"),
        ("seed", 3, "attributes: another seed or title than in the campaign's text"),
        ("title", "", "attributes: another seed or title than in the campaign's text"),
        ("identity", "{", "attribute identity is no JSON object"),
        ("campaign_sha256", "", "identity has another digest"),
    ],
)
def test_a_changed_attribute_is_found(copy, name, value, expected):
    with h5py.File(copy, "r+") as file:
        file.attrs[name] = value
    assert expected in "\n".join(lines(copy, 1))


def test_a_compact_copy_with_an_unreadable_chunk_is_damaged(copy):
    compact = copy.with_name("compact.h5")
    write_compact(copy, compact)
    with h5py.File(compact) as file:
        chunk = file["samples"].id.get_chunk_info(0)
    flip(compact, chunk.byte_offset + 1, 0xFF)
    (said, _) = lines(compact, 1)
    assert said.startswith(f"{compact}: a damaged campaign file (")


def test_tables_of_the_wrong_length_are_damage(copy):
    with h5py.File(copy, "r+") as file:
        file.attrs["strings"] = int(file.attrs["strings"]) + 1
    assert "(/strings has the shape (28,), not (29,))" in "\n".join(lines(copy, 1))


def test_a_truncated_file_is_damaged_beyond_what_a_resume_can_read(agglom, copy):
    with copy.open("r+b") as file:
        file.truncate(copy.stat().st_size - 1)
    done = agglom("check", copy)
    assert (done.exit_code, done.stderr) == (1, "")
    assert done.stdout.splitlines() == [
        f"{copy}: a truncated HDF5 file",
        "  no resume can read it: restore a copy, or start afresh with --output",
    ]


def test_what_is_no_campaign_file_is_bad_input(mistaken, tmp_path):
    (tmp_path / "text.h5").write_text("no database")
    with h5py.File(tmp_path / "other.dat", "w") as file:
        file["x"] = 1
    assert mistaken("check", "nothing.h5") == "nothing.h5: No such file or directory"
    assert mistaken("check", tmp_path / "text.h5").endswith("text.h5: not an HDF5 file")
    assert mistaken("check", tmp_path / "other.dat").endswith("not an agglom_mpi campaign")


def test_a_campaign_file_is_known_by_its_content(agglom, copy):
    copy.rename(copy.with_name("results"))
    assert agglom("check", copy.with_name("results")).stdout.endswith("generations are done\n")


def test_every_table_is_read_or_known_to_have_no_checksum(copy):
    with h5py.File(copy, "r") as file:
        tables = TableSizes.of(file.attrs).tables()
    assert {table.name for table in tables if table.final} == {*TABLES, "legs", "failures"}


def test_a_torn_generation_and_an_absent_result_of_it_are_both_named(copy):
    with h5py.File(copy, "r+") as file:
        row = file["generations"][2]
        row["seconds"] += 1.0
        file["generations"][2] = row
        string = int(np.flatnonzero(file["results_done"][:])[-1])
        file["results_done"][string] = 0
    text, code = check_file(str(copy))
    assert code == 1
    assert "generations: 2 with a wrong checksum" in text
    assert f"results: {string} absent" in text


def test_a_report_leaves_out_a_string_whose_row_is_damaged(agglom, copy):
    best = int(open_campaign(copy).best(1)["string"][0])
    with h5py.File(copy, "r+") as file:
        row = file["strings"][best]
        row["slot"] += 1
        file["strings"][best] = row
    done = agglom("report", copy)
    assert done.exit_code == 1
    assert "1 damaged row left out" in done.stderr
    numbers = next(line for line in done.stdout.splitlines() if line.startswith("string "))
    assert str(best) not in numbers.split()[1:]
