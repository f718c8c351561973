import os
from pathlib import Path

import pytest
from campaign_runs import SMALL, write_campaign

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import OutputError, check_same_campaign, output_path, prepare


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return load_campaign(write_campaign(tmp_path / "small.yaml", **SMALL))


def test_the_file_is_named_after_the_campaign_unless_told_otherwise(campaign):
    assert str(output_path(campaign, None)) == "small.h5"
    assert str(output_path(campaign, "other.h5")) == "other.h5"


def test_a_directory_is_no_output_file(campaign, tmp_path):
    with pytest.raises(OutputError, match="is a directory"):
        output_path(campaign, str(tmp_path))


def test_a_missing_directory_is_named(campaign):
    with pytest.raises(OutputError, match=r"the directory no/where does not exist"):
        output_path(campaign, "no/where/x.h5")


def test_a_directory_that_cannot_be_written_is_refused(campaign, tmp_path, monkeypatch):
    # The tests may run as root, whom the permission bits do not stop.
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(OutputError, match="cannot be written"):
        output_path(campaign, "x.h5")


def test_a_read_only_file_is_refused(campaign, tmp_path, monkeypatch):
    file = tmp_path / "x.h5"
    file.touch()
    monkeypatch.setattr(os, "access", lambda path, mode: str(path) != "x.h5")
    with pytest.raises(OutputError, match="is read-only"):
        output_path(campaign, "x.h5")


def test_the_same_campaign_is_let_through(campaign, tmp_path):
    check_same_campaign(tmp_path, campaign.identity(), campaign.identity())


def test_every_difference_between_two_campaigns_is_shown(campaign, tmp_path):
    stored = campaign.identity() | {"scene.particles": 200, "gone": 1}
    del stored["search.population"]
    with pytest.raises(OutputError) as caught:
        check_same_campaign(tmp_path, stored, campaign.identity())
    lines = [line.strip() for line in str(caught.value).splitlines()[1:]]
    assert lines == [
        "gone: 1 in the file, absent now",
        "scene.particles: 200 in the file, 100 now",
        "search.population: absent in the file, 12 now",
    ]


def test_a_stored_campaign_is_found_again_with_all_its_identity(campaign, tmp_path):
    made = prepare(tmp_path / "x.h5", InversionExperiment(campaign), accept_code_change=False)
    again = prepare(tmp_path / "x.h5", InversionExperiment(campaign), accept_code_change=False)
    assert made.identity == again.identity == campaign.identity()
    assert again.campaign_text == campaign.text


def test_more_generations_make_room_for_more_strings(campaign, tmp_path):
    prepare(tmp_path / "x.h5", InversionExperiment(campaign), accept_code_change=False)
    longer = campaign.with_generations(9)
    prepare(tmp_path / "x.h5", InversionExperiment(longer), accept_code_change=False)
    again = prepare(tmp_path / "x.h5", InversionExperiment(campaign), accept_code_change=False)
    assert again.attributes["strings"] == longer.max_strings


@pytest.mark.parametrize(
    ("output", "wanted"),
    [
        (None, "small_seed3.h5"),
        ("other.h5", "other_seed3.h5"),
        ("a.b.h5", "a.b_seed3.h5"),
        ("bare", "bare_seed3"),
        ("small_seed3.h5", "small_seed3.h5"),
        ("small_seed13.h5", "small_seed13_seed3.h5"),
    ],
)
def test_a_seed_that_is_given_is_part_of_the_name(campaign, output, wanted):
    assert str(output_path(campaign, output, seed=3)) == wanted


def test_a_seed_is_part_of_the_campaigns_own_name_too(campaign):
    own = Campaign.from_text(f"output: {{file: own.h5}}\n{campaign.text}")
    assert str(output_path(own, None)) == "own.h5"
    assert str(output_path(own, None, seed=0)) == "own_seed0.h5"


@pytest.mark.parametrize("output", [".", "..", "/"])
def test_a_directory_is_no_output_file_whatever_the_seed(campaign, output):
    with pytest.raises(OutputError, match="is a directory"):
        output_path(campaign, output, seed=3)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [("small_seed7.h5", "; --seed 7 continues it"), ("x.h5", "; 'seed: 7' in the campaign")],
)
def test_another_seed_is_said_with_the_way_to_continue(campaign, name, remedy):
    held, asked = campaign.identity() | {"seed": 7}, campaign.identity() | {"seed": 8}
    with pytest.raises(OutputError, match=f"{name}: was made with seed 7, not 8{remedy}"):
        check_same_campaign(Path(name), held, asked)
