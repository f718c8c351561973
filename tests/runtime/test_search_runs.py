"""Runs of the searches besides the published one: the same decisions however they are run."""

import sys

import h5py
import numpy as np
import pytest
from campaign_runs import (
    assert_same,
    assert_sound,
    decisions,
    finish,
    inject,
    invert,
    need_mpirun,
    state,
    stop,
)
from once import made_once, shared_folder
from search_runs import SEARCHES, write_search

from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.errors import MissingLibraryError
from agglom_mpi.planning.plan import plan
from agglom_mpi.runtime.file_setup import OutputError, prepare
from agglom_mpi.runtime.invert import InvertOptions, read_request
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.recorded_campaign import recorded_campaign


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Return a folder with a finished campaign of every search, run without MPI."""

    def make(folder):
        for name, search in SEARCHES.items():
            write_search(folder / f"{name}.yaml", search)
            finish(folder, f"{name}.yaml")

    return made_once(shared_folder(tmp_path_factory) / "searches", make)


@pytest.mark.parametrize("search", SEARCHES)
def test_a_run_is_sound_and_holds_all_strings(plain, search):
    path = plain / f"{search}.h5"
    strings = 9 + 3 * 7 if search == "surrogate" else 5 * 7
    said = assert_sound(path)
    assert f"{strings} of {strings} strings, {strings} of {strings} results and 5 of 5" in said
    assert state(path) == ("finished", "all 5 generations are done")
    file = read_campaign(path)
    assert len(file.all_sample_rows()) == 3 * strings


@pytest.mark.slow
@pytest.mark.parametrize(
    ("search", "legs"),
    [
        ("surrogate", (3, 2)),
        ("cmaes", (2, None)),
    ],
)
def test_decisions_depend_neither_on_ranks_nor_on_interruptions(plain, tmp_path, search, legs):
    need_mpirun()
    write_search(tmp_path / f"{search}.yaml", SEARCHES[search])
    code, said = stop(tmp_path, search, ranks=legs[0])
    assert code == 75, said
    assert_sound(tmp_path / f"{search}.h5")
    finish(tmp_path, f"{search}.yaml", ranks=legs[1])
    assert_same(tmp_path / f"{search}.h5", decisions(plain / f"{search}.h5"))
    assert_sound(tmp_path / f"{search}.h5")


@pytest.mark.parametrize("search", ["surrogate", "cmaes", "sobol"])
def test_a_campaign_in_two_legs_decides_as_in_one(plain, tmp_path, search):
    write_search(tmp_path / f"{search}.yaml", SEARCHES[search])
    finish(tmp_path, f"{search}.yaml", "--generations", "2")
    finish(tmp_path, f"{search}.yaml")
    assert len(read_campaign(tmp_path / f"{search}.h5").legs()) == 2
    assert_same(tmp_path / f"{search}.h5", decisions(plain / f"{search}.h5"))


def test_the_earlier_file_may_vanish_when_a_campaign_has_begun(plain, tmp_path):
    earlier = tmp_path / "earlier.h5"
    earlier.write_bytes((plain / "sobol.h5").read_bytes())
    section = f"{SEARCHES['surrogate'][:-1]}, start: {{file: earlier.h5, strings: 3}}}}"
    write_search(tmp_path / "next.yaml", section, generations=2)
    finish(tmp_path, "next.yaml", "--generations", "1")
    earlier.unlink()
    assert_sound(tmp_path / "next.h5")
    finish(tmp_path, "next.yaml")
    assert_sound(tmp_path / "next.h5")
    theirs, ours = read_campaign(plain / "sobol.h5"), read_campaign(tmp_path / "next.h5")
    best = theirs.string_rows()[theirs.generation_rows()["population"][-1][:3]]
    names = ["relative_speed", "size_ratio", "hardness"]
    assert ours.string_rows()[:3][names].tolist() == best[names].tolist()
    assert ours.string_rows()["origin"][:4].tolist() == [3, 3, 3, 0]


@pytest.fixture(scope="module")
def again(tmp_path_factory):
    """Return a file of strings of which four were estimated again, and their order by that."""
    folder = tmp_path_factory.mktemp("again")
    write_search(folder / "again.yaml", SEARCHES["sobol"], final="{strings: 4, samples: 4}")
    finish(folder, "again.yaml")
    file = open_campaign(folder / "again.h5")
    return folder / "again.h5", file.best(4)["string"].tolist()


def own_ranks(path):
    """Strings of a file in the order of the search's own objectives."""
    results = read_campaign(path).result_rows()
    return results["string"][np.argsort(results["objective"], kind="stable")].tolist()


def assert_begins_with(path, earlier, order):
    """Compare the given strings of a campaign with strings of an earlier one."""
    names = ["relative_speed", "size_ratio", "hardness"]
    wanted = read_campaign(earlier).string_rows()[order]
    assert read_campaign(path).string_rows()[: len(order)][names].tolist() == wanted[names].tolist()


def test_a_search_begins_with_the_best_by_estimates_and_then_by_the_searchs_own_ranks(
    again, tmp_path
):
    path, best = again
    own = own_ranks(path)
    assert best != own[:4], "it is no test if both orders agree"
    assert sorted(best) == sorted(own[:4])
    section = f"{SEARCHES['random'][:-1]}, start: {{file: {path}, strings: 6}}}}"
    write_search(tmp_path / "next.yaml", section, samples=1, generations=1)
    finish(tmp_path, "next.yaml")
    assert_begins_with(tmp_path / "next.h5", path, [*best, *own[4:6]])
    assert_sound(tmp_path / "next.h5")


def test_a_campaign_that_has_begun_keeps_its_strings_when_the_earlier_one_is_estimated_again(
    plain, again, tmp_path
):
    path, best = again
    bare, earlier = plain / "sobol.h5", tmp_path / "earlier.h5"
    earlier.write_bytes(bare.read_bytes())
    section = f"{SEARCHES['random'][:-1]}, start: {{file: earlier.h5, strings: 3}}}}"
    write_search(tmp_path / "next.yaml", section, samples=1, generations=2)
    finish(tmp_path, "next.yaml", "--generations", "1")
    earlier.write_bytes(path.read_bytes())
    finish(tmp_path, "next.yaml")
    assert best[:3] != own_ranks(path)[:3], "it is no test if both orders agree"
    assert_begins_with(tmp_path / "next.h5", earlier, own_ranks(path)[:3])
    assert_sound(tmp_path / "next.h5")
    damage_size_ratio(tmp_path / "next.h5", 0)
    done = invert(tmp_path, "next.yaml")
    assert done.returncode == 2
    assert done.stderr.rstrip().endswith(
        "search.start: earlier.h5: has other best strings now than this campaign began with, of "
        "which 0 is lost"
    )
    earlier.write_bytes(bare.read_bytes())
    finish(tmp_path, "next.yaml")
    assert_sound(tmp_path / "next.h5")


WITHOUT = """
import sys
for name in {names}:
    sys.modules[name] = None
"""


@pytest.mark.parametrize(
    ("search", "names", "missing"),
    [
        ("cmaes", ["cmaes"], "cmaes"),
    ],
)
def test_a_missing_library_is_one_message(plain, tmp_path, monkeypatch, search, names, missing):
    for name in names:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.chdir(plain)
    with pytest.raises(CampaignError) as caught:
        read_request(InvertOptions(f"{search}.yaml", output=str(tmp_path / "new.h5")))
    line = (plain / f"{search}.yaml").read_text().splitlines().index(f"search: {SEARCHES[search]}")
    message = str(caught.value)
    assert message.startswith(f"{search}.yaml:{line + 1}: search.method: is '{search}'")
    assert f"need {missing}: pip install 'agglom_mpi[search]'" in message
    with pytest.raises(MissingLibraryError):
        plan(f"{search}.yaml", (1,), 20.0, source=f"{search}.h5")


@pytest.mark.slow
def test_on_several_ranks_a_missing_library_is_one_message_too(plain, tmp_path):
    need_mpirun()
    folder = inject(tmp_path / "inject", WITHOUT.format(names=["cmaes"]))
    done = invert(plain, "cmaes.yaml", "-o", tmp_path / "new.h5", ranks=2, inject=folder)
    assert done.returncode == 2
    assert done.stderr.count("pip install 'agglom_mpi[search]'") == 1
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "new.h5").exists()


def test_a_search_without_a_method_needs_no_extra_library(tmp_path, monkeypatch):
    write_search(tmp_path / "tiny.yaml", "{}", samples=1, generations=2)
    monkeypatch.setitem(sys.modules, "cmaes", None)
    finish(tmp_path, "tiny.yaml")


@pytest.mark.parametrize("section", ["{}", "{start: [{hardness: 50 MPa}]}"])
def test_a_file_made_with_another_default_is_read_and_continued_by_its_own(
    tmp_path, monkeypatch, section
):
    path = write_search(tmp_path / "tiny.yaml", section, samples=1, generations=2)
    with monkeypatch.context() as earlier:
        earlier.setattr("agglom_mpi.search.methods.method.DEFAULT_METHODS", ("genetic",))
        finish(tmp_path, "tiny.yaml")
    assert load_campaign(path).search.name == "surrogate"
    file = tmp_path / "tiny.h5"
    assert recorded_campaign(read_campaign(file)).search.name == "genetic"
    assert plan(str(path), (1,), 20.0, source=str(file)).campaign.search.name == "genetic"
    finish(tmp_path, "tiny.yaml", "--generations", 3)
    assert_sound(file)
    assert len(read_campaign(file).string_rows()) == 20 + 14 + 14


def test_a_text_that_names_another_method_than_its_file_is_refused(tmp_path):
    path = write_search(tmp_path / "tiny.yaml", "{method: sobol}", samples=1, generations=1)
    finish(tmp_path, "tiny.yaml")
    path.write_text(path.read_text().replace("{method: sobol}", "{method: random}"))
    with pytest.raises(OutputError, match=r"search\.method: sobol in the file, random now"):
        prepare(tmp_path / "tiny.h5", read_request(InvertOptions(str(path))).experiment, False)


def test_checking_a_file_without_the_library_says_so_and_does_not_call_it_damaged(
    plain, monkeypatch
):
    monkeypatch.setitem(sys.modules, "cmaes", None)
    with pytest.raises(MissingLibraryError, match="is 'cmaes'"):
        check_file(str(plain / "cmaes.h5"))


def damage_size_ratio(path, string):
    """Change a number of a string, so that its checksum is wrong."""
    with h5py.File(path, "r+") as file:
        row = file["strings"][string]
        row["size_ratio"] += 1e-3
        file["strings"][string] = row


@pytest.mark.parametrize("start", ["[{hardness: 50 MPa}, {size_ratio: 0.5}]", "EARLIER"])
def test_a_lost_row_of_a_given_string_is_the_only_thing_found(plain, tmp_path, start):
    if start == "EARLIER":
        start = f"{{file: {plain / 'sobol.h5'}, strings: 2}}"
    section = f"{SEARCHES['random'][:-1]}, start: {start}}}"
    write_search(tmp_path / "lost.yaml", section, samples=1, generations=2)
    finish(tmp_path, "lost.yaml")
    assert_sound(tmp_path / "lost.h5")
    damage_size_ratio(tmp_path / "lost.h5", 0)
    said, code = check_file(str(tmp_path / "lost.h5"))
    assert code == 1
    assert "a resume would propose again strings 0" in said
    assert "replay: the search" not in said, said
    assert "replay: not" not in said, said
    finish(tmp_path, "lost.yaml")
    assert_sound(tmp_path / "lost.h5")


def begin_with(folder, start, monkeypatch):
    """Read a campaign that begins with strings of a file."""
    section = f"{{method: random, population: 36, start: {start}}}"
    write_search(folder / "next.yaml", section)
    monkeypatch.chdir(folder)
    read_request(InvertOptions("next.yaml"))


@pytest.mark.parametrize(
    ("start", "said"),
    [
        ("{file: gone.h5}", "gone.h5"),
        ("{file: next.yaml}", "next.yaml: not an HDF5 file"),
        ("{file: other.h5}", "other.h5: "),
        ("{file: few.h5, strings: 36}", "few.h5: has 35 judged strings; 36 are asked for"),
    ],
)
def test_an_earlier_file_that_cannot_be_used_is_one_message(
    plain, tmp_path, monkeypatch, start, said
):
    (tmp_path / "few.h5").write_bytes((plain / "sobol.h5").read_bytes())
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["something"] = 1
    with pytest.raises(CampaignError) as caught:
        begin_with(tmp_path, start, monkeypatch)
    lines = (tmp_path / "next.yaml").read_text().splitlines()
    [line] = [i for i, text in enumerate(lines, 1) if text.startswith("search:")]
    assert str(caught.value).startswith(f"next.yaml:{line}: search.start: {said}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("search", ["cmaes", "sobol"])
def test_a_forecast_of_every_search_keeps_its_bound(plain, monkeypatch, search):
    monkeypatch.chdir(plain)
    made = plan(f"{search}.yaml", (1, 8), 20.0, source=f"{search}.h5")
    strings = len(read_campaign(plain / f"{search}.h5").string_rows())
    for forecast in made.forecasts:
        assert forecast.used == 3 * strings
        assert 0.0 < forecast.bound <= forecast.seconds * (1.0 + 1e-9)
    assert made.not_forecast == []
