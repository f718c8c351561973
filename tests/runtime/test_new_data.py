"""Other data for the samples that a file has: nothing is simulated again that is stored."""

import shutil

import numpy as np
import pytest
from campaign_runs import assert_sound, invert
from experiment_runs import SLOW, THREE, write_experiments
from measured_runs import write_measured

from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.storage.attributes import earlier_data
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.recorded_campaign import recorded_campaign

COUNTED = {"output": ("final: {", "output: {census: [1 ms]}\nfinal: {")}
"""A census more than there are data."""
EARLIER = {"data": ("value: 0.35, error: 0.05", "value: 0.6, error: 0.02, time: 1 ms")}
"""A measurement at its time, in place of one at the end."""
RANDOM = {"search": ("{population: 6, parents: 2}", "{method: random, population: 6}")}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    write_measured(folder, **COUNTED)
    assert invert(folder, "measured.yaml").returncode == 0
    return folder


@pytest.fixture
def folder(made, tmp_path):
    shutil.copy(made / "measured.h5", tmp_path)
    write_measured(tmp_path, **COUNTED, **EARLIER)
    return tmp_path


def test_all_is_decided_again_by_the_stored_samples(folder, made):
    before = read_campaign(made / "measured.h5")
    assert invert(folder, "measured.yaml", "--accept-new-data").returncode == 0
    after = read_campaign(folder / "measured.h5")
    assert after.identity == load_campaign(folder / "measured.yaml").identity()
    searched = after.searched_samples
    assert searched.tobytes() == before.searched_samples.tobytes()
    assert after.string_rows().tobytes() == before.string_rows().tobytes()
    assert not np.isin(after.result_rows()["objective"], before.result_rows()["objective"]).any()
    [kept] = earlier_data(after.attributes)
    assert (kept["legs"], kept["strings"]) == (1, len(before.string_rows()))
    assert kept["data"]["data.2.value"] == 0.35
    assert_sound(folder / "measured.h5")


def test_the_campaign_goes_on_with_the_new_data(folder):
    more = "--generations", "4"
    assert invert(folder, "measured.yaml", "--accept-new-data", *more).returncode == 0
    file = read_campaign(folder / "measured.h5")
    assert len(file.generation_rows()) == 4
    assert file.strings_of_earlier_data == 14 < len(file.string_rows())
    assert invert(folder, "measured.yaml", "--generations", "5").returncode == 0
    assert_sound(folder / "measured.h5")


def test_results_are_those_of_a_run_that_had_the_data_from_the_start(tmp_path):
    """A search of random strings proposes the same strings whatever was measured."""
    write_measured(tmp_path, **COUNTED, **RANDOM)
    assert invert(tmp_path, "measured.yaml").returncode == 0
    write_measured(tmp_path, **COUNTED, **RANDOM, **EARLIER)
    assert invert(tmp_path, "measured.yaml", "--accept-new-data").returncode == 0
    assert invert(tmp_path, "measured.yaml", "--output", "new.h5").returncode == 0
    accepted, new = (read_campaign(tmp_path / name) for name in ("measured.h5", "new.h5"))
    assert accepted.result_rows().tobytes() == new.result_rows().tobytes()
    digests = [each.generation_rows()["digest"].tolist() for each in (accepted, new)]
    assert digests[0] == digests[1]
    assert open_campaign(tmp_path / "measured.h5").best()["string"].tolist() == (
        open_campaign(tmp_path / "new.h5").best()["string"].tolist()
    )


def test_new_data_need_leave_and_the_error_names_the_option(folder):
    content = (folder / "measured.h5").read_bytes()
    done = invert(folder, "measured.yaml")
    assert done.returncode == 2
    assert "--accept-new-data" in done.stderr
    assert (folder / "measured.h5").read_bytes() == content


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("time: 1 ms}", "time: 4 ms}", "0.004 s"),
        ("particles: 40", "particles: 50", "scene.particles"),
        ("seed: 1", "seed: 2", "seed"),
    ],
)
def test_what_the_samples_do_not_have_is_refused(folder, old, new, said):
    content = (folder / "measured.h5").read_bytes()
    path = folder / "measured.yaml"
    path.write_text(path.read_text().replace(old, new))
    done = invert(folder, "measured.yaml", "--accept-new-data")
    assert done.returncode == 2
    assert said in done.stderr
    assert (folder / "measured.h5").read_bytes() == content


def test_samples_that_the_former_data_added_to_strings_are_refused(tmp_path):
    again = {"search": ("parents: 2}", "parents: 2, more_samples: 2}")}
    write_measured(tmp_path, **COUNTED, **again)
    assert invert(tmp_path, "measured.yaml").returncode == 0
    write_measured(tmp_path, **COUNTED, **again, **EARLIER)
    done = invert(tmp_path, "measured.yaml", "--accept-new-data")
    assert (done.returncode, "search.more_samples" in done.stderr) == (2, True)


def test_an_experiment_gets_its_first_data(tmp_path):
    write_experiments(tmp_path)
    assert invert(tmp_path, "experiments.yaml").returncode == 0
    datum = "data: [{quantity: particles_left, value: 0.4, error: 0.1}]"
    measured = THREE.replace("0.5 m/s}", "0.5 m/s}, " + datum)
    write_experiments(tmp_path, measured)
    assert invert(tmp_path, "experiments.yaml", "--accept-new-data").returncode == 0
    campaign = recorded_campaign(read_campaign(tmp_path / "experiments.h5"))
    assert [each.experiment for each in campaign.data] == ["slow", "slow", "fast", "faster"]
    assert_sound(tmp_path / "experiments.h5")
    write_experiments(tmp_path, SLOW)
    assert invert(tmp_path, "experiments.yaml", "--accept-new-data").returncode == 2


def test_times_of_censuses_are_no_part_of_the_identity(tmp_path):
    plain = load_campaign(write_measured(tmp_path))
    more = load_campaign(write_measured(tmp_path, **COUNTED))
    assert more.census.times == (1e-3, *plain.census.times)
    assert more.sha256() == plain.sha256()


@pytest.mark.parametrize("times", ["[7 ms]", "[0]", "soon"])
def test_a_census_is_at_a_time_that_samples_reach(tmp_path, times):
    text = {"output": ("final: {", f"output: {{census: {times}}}\nfinal: {{")}
    with pytest.raises(CampaignError, match=r"yaml:23: output\.census"):
        load_campaign(write_measured(tmp_path, **text))
