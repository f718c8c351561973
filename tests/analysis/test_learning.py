"""Samples of another campaign with the same scene are data of a search and of its emulator."""

import re

import h5py
import numpy as np
import pytest
from analysis_answers import write_data
from campaign_runs import finish
from click.testing import CliRunner
from search_runs import write_search

import agglom_mpi
from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.analysis.warm_start import evaluated, warm_start
from agglom_mpi.cli import main
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.inference.stored_samples import stored_samples
from agglom_mpi.outcome import FAILED
from agglom_mpi.runtime.invert import InvertOptions, read_request
from agglom_mpi.storage.access import DamagedCampaign
from agglom_mpi.storage.compact import write_compact
from agglom_mpi.storage.reader import read_campaign

SEARCH = "{method: surrogate, initial: 9, batch: 4, learn_from: %s}"
SCENE = ("relative_speed", "size_ratio", "hardness")


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """Return the file of a campaign of 14 strings, with two samples each."""
    folder = tmp_path_factory.mktemp("earlier")
    write_search(folder / "one.yaml", "{method: sobol, population: 7}", samples=2, generations=2)
    finish(folder, "one.yaml")
    return folder / "one.h5"


def next_text(folder, file, *replaced, **options):
    """Return the text of a campaign that learns from a file, with growth by half as its target."""
    options = {"samples": 1, "generations": 2} | options
    text = write_search(folder / "next.yaml", SEARCH % file, **options).read_text()
    for old, new in (("ratio: 2", "ratio: 1.5"), *replaced):
        assert old in text
        text = text.replace(old, new)
    (folder / "next.yaml").write_text(text)
    return text


@pytest.fixture(scope="module")
def learned(earlier, tmp_path_factory):
    """Return the finished file of a campaign that learns from it."""
    folder = tmp_path_factory.mktemp("learned")
    next_text(folder, earlier)
    finish(folder, "next.yaml")
    return folder / "next.h5"


def learning_of(text):
    campaign = Campaign.from_text(text)
    return campaign, warm_start(campaign).learned


def test_means_are_those_of_the_other_samples_by_the_target_of_this_campaign(earlier, tmp_path):
    campaign, learned = learning_of(next_text(tmp_path, earlier))
    found, theirs = evaluated(campaign, learned.rows), read_campaign(earlier)
    rows, results = theirs.string_rows(), theirs.result_rows()
    order = np.lexsort([rows[name] for name in reversed(SCENE)])
    wanted = [rows[name][order] for name in SCENE]
    assert np.array_equal(found.parameters[:, [0, 1, 3]].T, wanted)
    wanted = results["mean_radius_ratio"][order] / 1.5 - 1.0
    assert found.deviations == pytest.approx(wanted, rel=1e-12)
    assert found.objectives == pytest.approx(abs(wanted), rel=1e-12)
    assert found.samples.tolist() == [2] * 14


def test_a_string_with_too_many_failed_samples_has_no_objective(earlier, tmp_path):
    campaign, learned = learning_of(next_text(tmp_path, earlier))
    rows = learned.rows.copy()
    bad = rows["string"] == 3
    rows["state"][bad] = FAILED
    found = evaluated(campaign, rows)
    assert np.isinf(found.objectives).sum() == 1
    assert sorted(found.samples.tolist()) == [0, *[2] * 13]


REFUSED = {
    "scene.particles": ("particles: 100", "particles: 90"),
    "scene.friction": ("friction: restitution_scaled", "friction: constant"),
    "scene.contact_area.initial": ("initial: 0.01", "initial: 0.02"),
    "variables.density": ("density: 6142", "density: 6100"),
    "variables.friction": ("friction: 0.307", "friction: [0.1, 0.3]"),
    "variables.hardness": ("[10 MPa, 200 MPa]", "60 MPa"),
    "variables.hardness.scale": ("[10 MPa, 200 MPa]", "[10 MPa, 200 MPa, log]"),
}


@pytest.mark.parametrize("field", REFUSED)
def test_another_scene_or_fixed_number_is_refused_by_its_name(earlier, tmp_path, field):
    with pytest.raises(CampaignError) as caught:
        learning_of(next_text(tmp_path, earlier, REFUSED[field]))
    [problem] = caught.value.problems
    assert problem.field == "search.learn_from"
    assert problem.line is not None
    assert f" {field}" in problem.message


def test_a_file_that_is_absent_or_no_campaign_is_one_problem(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["something"] = 1
    for name in ("gone.h5", "other.h5", "next.yaml"):
        with pytest.raises(CampaignError) as caught:
            learning_of(next_text(tmp_path, tmp_path / name))
        assert [each.field for each in caught.value.problems] == ["search.learn_from"]


def test_correlated_samples_are_refused(tmp_path):
    write_search(tmp_path / "one.yaml", "{method: sobol, population: 7}", generations=1)
    text = (tmp_path / "one.yaml").read_text()
    text = text.replace("samples: 3}", "samples: 3, common_configurations: true}")
    (tmp_path / "one.yaml").write_text(text)
    finish(tmp_path, "one.yaml")
    with pytest.raises(CampaignError, match=r"ensemble\.common_configurations"):
        learning_of(next_text(tmp_path, tmp_path / "one.h5"))


def test_the_methods_without_a_model_do_not_know_the_key(tmp_path):
    text = next_text(tmp_path, "one.h5", ("surrogate, initial: 9, batch: 4", "sobol"))
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(text)
    assert [each.field for each in caught.value.problems] == ["search.learn_from"]


def test_strings_outside_of_the_box_and_of_the_constraints_are_learned(earlier, tmp_path):
    limit = ("\nobjective:", "\nconstraints: ['hardness < 100 MPa']\nobjective:")
    _, found = learning_of(next_text(tmp_path, earlier, ("[0.4, 0.8]", "[0.5, 0.6]"), limit))
    assert len(found.rows) == 28
    ratios = found.rows["learned_string"][:, 1]
    assert ratios.min() < 0.5
    assert ratios.max() > 0.6


def test_samples_of_strings_that_are_given_are_not_learned(earlier, tmp_path):
    start = ("batch: 4", f"batch: 4, start: {{file: {earlier}, strings: 2}}")
    campaign = Campaign.from_text(next_text(tmp_path, earlier, start))
    found = warm_start(campaign)
    assert len(found.learned.rows) == 24
    learned = np.nan_to_num(found.learned.rows["learned_string"])
    assert not any((learned == each).all(axis=1).any() for each in np.nan_to_num(found.strings))


def test_the_name_is_relative_to_the_folder_of_the_campaign(earlier, tmp_path, monkeypatch):
    folder = tmp_path / "campaigns"
    folder.mkdir()
    (folder / "near.h5").write_bytes(earlier.read_bytes())
    (tmp_path / "far.h5").write_bytes(earlier.read_bytes())
    monkeypatch.chdir(tmp_path)
    next_text(folder, "near.h5")
    assert len(warm_start(load_campaign("campaigns/next.yaml")).learned.rows) == 28
    next_text(folder, "far.h5")
    done = CliRunner().invoke(main, ["check", "campaigns/next.yaml"])
    assert done.exit_code == 2
    assert "search.learn_from" in done.stderr


def measured_text(folder, *replaced):
    """Return the text of a campaign that learns from one with measured data."""
    text = (folder / "measured.yaml").read_text()
    search = "search: {method: surrogate, learn_from: measured.h5}"
    text = re.sub(r"(?m)^search: .*$", search, text)
    for old, new in replaced:
        assert old in text
        text = text.replace(old, new)
    (folder / "next.yaml").write_text(text)
    return folder / "next.yaml"


def test_censuses_are_learned_with_other_measured_values_but_not_at_other_times(tmp_path):
    finish(tmp_path, write_data(tmp_path))
    campaign = load_campaign(measured_text(tmp_path, ("value: 130 um", "value: 140 um")))
    rows = warm_start(campaign).learned.rows
    found = evaluated(campaign, rows)
    string = found.parameters[0]
    own = rows[(np.nan_to_num(rows["learned_string"]) == np.nan_to_num(string)).all(axis=1)]
    assert found.objectives[0] == campaign.objective_at(string).of_rows(own)[0]
    with pytest.raises(CampaignError, match="data: "):
        warm_start(load_campaign(measured_text(tmp_path, ("time: 2 ms", "time: 3 ms"))))


def test_a_search_of_ones_own_loop_learns_too(earlier, tmp_path):
    next_text(tmp_path, earlier)
    strings = agglom_mpi.load_campaign(tmp_path / "next.yaml").searcher().ask()
    assert set(strings["origin"].tolist()) == {"model"}


def test_samples_of_other_sources_need_leave(earlier, tmp_path, monkeypatch):
    monkeypatch.setattr("agglom_mpi.runtime.invert.sources_digest", lambda: "other")
    next_text(tmp_path, earlier)
    options = InvertOptions(str(tmp_path / "next.yaml"), str(tmp_path / "next.h5"))
    with pytest.raises(CampaignError) as caught:
        read_request(options)
    assert [each.field for each in caught.value.problems] == ["search.learn_from"]
    request = read_request(options._replace(accept_code_change=True))
    assert request.experiment.table_sizes.learned == 28


def test_the_file_names_what_it_learned_and_its_results_are_its_own(earlier, learned):
    file, other = read_campaign(learned), read_campaign(earlier)
    assert file.attributes["learned_from"] == str(earlier)
    assert file.attributes["learned_from_sha256"] == other.attributes["campaign_sha256"]
    assert file.identity["search.learn_from"] == str(earlier)
    assert len(file.string_rows()) == len(file.result_rows()) == 9
    assert set(file.string_rows()["origin"].tolist()) == {2}
    theirs = other.all_sample_rows()
    assert len(file.learned_rows()) == len(theirs) == 28
    ratios = (np.sort(each["mean_radius_ratio"]) for each in (file.learned_rows(), theirs))
    assert np.array_equal(*ratios)


def test_an_emulator_of_the_file_rests_on_both(earlier, learned):
    stored = stored_samples(read_campaign(learned))
    assert len(stored.rows) == len(stored.strings) == 28 + 9
    assert len(stored.tried) == 14 + 9
    assert len(stored_samples(read_campaign(earlier)).rows) == 28


def test_a_copy_has_it_too_and_others_learn_from_that(learned, tmp_path):
    write_compact(learned, tmp_path / "copy.h5")
    assert check_file(str(tmp_path / "copy.h5"))[1] == 0
    _, found = learning_of(next_text(tmp_path, tmp_path / "copy.h5"))
    assert len(found.rows) == 28 + 9


def test_a_lost_row_is_found_and_the_campaign_is_not_continued(learned, tmp_path):
    path = tmp_path / "next.h5"
    path.write_bytes(learned.read_bytes())
    with h5py.File(path, "r+") as file:
        row = file["learned"][5]
        row["mean_radius_ratio"] += 1e-3
        file["learned"][5] = row
    said, code = check_file(str(path))
    assert code == 1
    assert "learned: 5 with a wrong checksum" in said
    text = read_campaign(path).campaign_text
    (tmp_path / "next.yaml").write_text(text)
    with pytest.raises(DamagedCampaign, match="1 row of /learned"):
        read_request(InvertOptions(str(tmp_path / "next.yaml"), str(path)))
