"""Parents that get more samples: the same decisions however the campaign is run."""

import re

import numpy as np
import pytest
from campaign_runs import (
    assert_same,
    assert_sound,
    decisions,
    finish,
    need_mpirun,
    stop,
    write_campaign,
)

from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.outcome import COLUMNS
from agglom_mpi.search.proposals import ORIGINS
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate

NUMBERS = {"generations": 4, "max_samples": 12, "population": 8, "parents": 4}


def write(folder):
    path = write_campaign(folder / "more.yaml", **NUMBERS)
    text = path.read_text()
    path.write_text(re.sub(r"parents: 4", "parents: 4, more_samples: 5", text))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("more")
    write(folder)
    finish(folder, "more.yaml")
    return folder / "more.h5"


def test_a_parent_has_its_own_samples_and_is_worth_all_of_them(undisturbed):
    file = read_campaign(undisturbed)
    campaign = Campaign.from_text(file.campaign_text)
    strings, samples = file.string_rows(), file.all_sample_rows()
    again = strings[strings["origin"] == ORIGINS.index("again")]
    assert len(again) == 3 * 4
    row = again[-1]
    parameters = np.array([row[name] for name in TEN.names])
    own = samples[samples["string"] == row["string"]]
    assert len(own) == 5
    first = campaign.first_sample(int(row["string"]))
    assert first > 0
    record = simulate(campaign, parameters, first + 2).record
    assert all(record[c.name].tobytes() == own[c.name][2].tobytes() for c in COLUMNS)
    line = [int(row["string"])]
    while strings["origin"][line[-1]] == ORIGINS.index("again"):
        line.append(int(strings["parents"][line[-1], 0]))
    results = file.result_rows()
    used = dict(zip(results["string"].tolist(), results["samples_used"].tolist(), strict=True))
    ratios = [
        samples["mean_radius_ratio"][(samples["string"] == s) & (samples["sample"] < used[s])]
        for s in line
    ]
    assert len(set(np.concatenate(ratios))) == sum(map(len, ratios)), "a sample was seen twice"
    mean = np.concatenate(ratios).mean()
    assert results["mean_radius_ratio"][row["string"]] == pytest.approx(mean, rel=1e-12)


def test_the_file_is_sound_and_a_sample_is_replayed_by_its_own_number(undisturbed, agglom_simulate):
    assert_sound(undisturbed)
    strings = read_campaign(undisturbed).string_rows()
    string = int(strings["string"][strings["origin"] == ORIGINS.index("again")][-1])
    assert "identical to the recorded sample" in agglom_simulate(undisturbed, string, 3)


@pytest.fixture
def agglom_simulate():
    from click.testing import CliRunner

    from agglom_mpi.cli import main

    def printed(path, string, sample):
        words = ["simulate", path, "--string", string, "--sample", sample]
        return CliRunner().invoke(main, [*map(str, words)]).stdout

    return printed


@pytest.mark.slow
@pytest.mark.parametrize("legs", [(None, 2), (2, 3)])
def test_ranks_and_an_interruption_change_nothing(undisturbed, tmp_path, legs):
    need_mpirun()
    write(tmp_path)
    code, errors = stop(tmp_path, "more", ranks=legs[0])
    assert code == 75, errors
    finish(tmp_path, "more.yaml", ranks=legs[1])
    assert_same(tmp_path / "more.h5", decisions(undisturbed))


def test_the_best_are_ranked_by_all_their_samples(undisturbed):
    file = open_campaign(undisturbed)
    ranked = read_campaign(undisturbed).generation_rows()["population"][-1]
    assert file.best(3)["string"].tolist() == ranked[:3].tolist()
