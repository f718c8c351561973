"""Every analysis rests on used and fresh samples, whatever ran ahead unused."""

import json

import pytest
from analysis_answers import answers, run, run_ahead, write_data, write_three
from campaign_runs import finish, need_mpirun

from agglom_mpi import open_campaign
from agglom_mpi.inference.stored_samples import stored_samples
from agglom_mpi.storage.reader import read_campaign

SET = ("--sensitivity", "--feasible-set", "--tolerance", "25%", "--measured", "2", "--error", "3%")
ONE_GENERATION = "{generations: 4, target: {top: 1, objective: 1e9}}"


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    """Return a finished file of 64 strings with room for more, and one with unused samples."""
    folder = tmp_path_factory.mktemp("unused")
    finish(folder, write_three(folder, "{method: sobol, population: 64}", ONE_GENERATION))
    path = folder / "three.h5"
    return path, run_ahead(path, folder / "ahead.h5", 3, 8)


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Return the same of a campaign with measured data."""
    folder = tmp_path_factory.mktemp("unused_data")
    finish(folder, write_data(folder))
    path = folder / "measured.h5"
    return path, run_ahead(path, folder / "ahead.h5", 2, 5)


def same(found, wanted):
    """Assert that analyses are the same, and name those that are not."""
    assert found.keys() == wanted.keys()
    assert [name for name in wanted if found[name] != wanted[name]] == []


def test_no_analysis_of_a_set_sees_samples_that_ran_ahead_unused(three, tmp_path):
    path, other = three
    same(*(answers(each, tmp_path / each.stem, *SET) for each in (other, path)))


def test_no_analysis_of_data_sees_samples_that_ran_ahead_unused(measured, tmp_path, monkeypatch):
    monkeypatch.setattr("agglom_mpi.inference.stored_samples.MIN_STRINGS", 5)
    path, other = measured
    same(*(answers(each, tmp_path / each.stem, "--posterior") for each in (other, path)))


def test_unused_samples_are_counted_and_written_if_asked_for(three, tmp_path):
    path, other = three
    few, many = (len(stored_samples(read_campaign(each)).rows) for each in (path, other))
    assert few == many
    used = read_campaign(other)
    words = ("report", other, "--feasible-set", "--tolerance", "25%", "--json")
    everything = json.loads(run(*words, "--unused"))["samples"]
    assert everything != few
    for words, samples, strings in (
        ([], len(used.counted_samples), len(used.result_rows())),
        (["--unused"], len(used.all_sample_rows()), len(used.string_rows())),
    ):
        folder = tmp_path / f"csv{len(words)}"
        run("export", other, "--csv", folder, *words)
        assert len((folder / "samples.csv").read_text().splitlines()) == 1 + samples
        assert len((folder / "strings.csv").read_text().splitlines()) == 1 + strings
    assert len(open_campaign(other).samples) == len(used.all_sample_rows())
    assert len(open_campaign(other).strings) == len(used.string_rows())


@pytest.mark.slow
def test_every_analysis_has_the_same_bits_on_1_and_3_ranks_and_each_time(tmp_path):
    need_mpirun()
    search, stopping = "{method: surrogate, initial: 32, batch: 16}", "{generations: 5}"
    # Ranks do not know where a rule of moments ends a string, and simulate further.
    write_three(tmp_path, search, stopping, "{rule: moments, tolerance: 0.1, max_samples: 20}")
    wanted, unused = None, set()
    for name, ranks in (("one", 1), ("three", 3), ("again", 3)):
        path = tmp_path / f"{name}.h5"
        finish(tmp_path, "three.yaml", "-o", path, ranks=ranks)
        found = answers(path, tmp_path / path.stem, *SET)
        wanted = wanted or found
        same(found, wanted)
        file = read_campaign(path)
        unused.add(len(file.all_sample_rows()) - len(file.counted_samples))
    assert max(unused) > 0
