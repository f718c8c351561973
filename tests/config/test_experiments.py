"""Section `experiments`: what each has of its own, what all share, and what is refused."""

import numpy as np
import pytest
from experiment_runs import FAST, FASTER, SLOW, THREE, write_experiments
from measured_runs import write_measured

from agglom_mpi.campaign_runs import load_campaign
from agglom_mpi.config.loading import campaign_of_record
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.measurements.layout import CensusLayout


@pytest.fixture
def campaign(tmp_path):
    return load_campaign(write_experiments(tmp_path))


def parts(campaign):
    return {each.name: each for each in campaign.experiments}


def test_a_range_within_an_experiment_is_a_variable_of_its_own(campaign):
    assert campaign.variables.searched == ("size_ratio", "fast.relative_speed")
    speed = campaign.variables["fast.relative_speed"]
    assert (speed.unit, speed.lower, speed.upper) == ("m/s", 0.1, 0.3)
    assert np.isnan(campaign.parameters()[campaign.variables.index("relative_speed")])


def test_each_experiment_takes_its_own_values_and_the_shared_ones(campaign):
    string = campaign.parameters({"volume_fraction": 0.1, "fast.relative_speed": "20 cm/s"})
    found = {name: each.campaign.at(each.own(string)) for name, each in parts(campaign).items()}
    speeds = {name: values["relative_speed"] for name, (_, values) in found.items()}
    assert speeds == {"slow": 0.05, "fast": 0.2, "faster": 0.5}
    assert len({values["size_ratio"] for _, values in found.values()}) == 1
    ends = {name: section.end_time for name, (section, _) in found.items()}
    assert ends == {"slow": 5e-3, "fast": 3e-3, "faster": 5e-3}


def test_data_belong_to_their_experiments(campaign):
    assert [(d.experiment, d.quantity) for d in campaign.data] == [
        ("slow", "sizes"),
        ("slow", "mean_diameter"),
        ("fast", "particles_left"),
    ]
    assert campaign.data[0].name.startswith("slow: ")


def test_an_experiment_without_data_is_counted_at_its_end(campaign):
    layouts = campaign.census
    assert {name: each.times for name, each in layouts.items()} == {
        "slow": (2e-3, np.inf),
        "fast": (np.inf,),
        "faster": (np.inf,),
    }


def test_a_campaign_without_experiments_has_no_entry_of_them(tmp_path):
    alone = load_campaign(write_measured(tmp_path))
    assert not [key for key in alone.identity() if key.startswith("experiment")]
    assert isinstance(alone.census, CensusLayout)


def test_a_stored_campaign_needs_no_file(campaign):
    again = campaign_of_record(campaign.text, "c.h5", campaign.identity())
    assert again.identity() == campaign.identity()
    assert again.data[0].values == pytest.approx(campaign.data[0].values, rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0.05 m/s", "0.06 m/s"),
        ("end_time: 3 ms", "end_time: 4 ms"),
        ("value: 0.35", "value: 0.36"),
        ("  faster:", "  fastest:"),
    ],
)
def test_what_an_experiment_has_is_in_the_identity(campaign, tmp_path, old, new):
    other = load_campaign(write_experiments(tmp_path, name="other", edit=(old, new)))
    assert other.sha256() != campaign.sha256()


def test_seeds_depend_on_seed_and_name_alone(campaign, tmp_path):
    more = load_campaign(write_experiments(tmp_path, FASTER + SLOW, name="more"))
    seeds = {name: each.campaign.seed for name, each in parts(campaign).items()}
    assert len(set(seeds.values())) == 3
    assert {n: e.campaign.seed for n, e in parts(more).items()} == {
        name: seeds[name] for name in ("faster", "slow")
    }
    assert not set(seeds.values()) & {
        each.campaign.seed for each in campaign.with_seed(2).experiments
    }


def test_an_experiment_replaces_the_key_that_stands_for_the_same(tmp_path):
    text = SLOW.replace("relative_speed: 0.05 m/s", "relative_speed: 1, size_ratio: 0.5")
    text = text.replace("data:", "scene: {half_width: 1 mm}, data:")
    found = parts(load_campaign(write_experiments(tmp_path, text + FAST)))
    assert found["slow"].campaign.variables.fixed["size_ratio"] == 0.5
    assert found["slow"].campaign.scene.diameter is None
    assert found["fast"].campaign.scene.diameter == 100e-6


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("relative_speed: 0.05 m/s", "relative_sped: 1", "experiments.slow.variables"),
        ("0.05 m/s", "5 kg", "experiments.slow.variables.relative_speed"),
        ("{relative_speed: 0.5 m/s}", "{density: 1}", "experiments.faster.variables"),
        ("{end_time: 3 ms}", "{end: 3 ms}", "experiments.fast.scene"),
        ("{end_time: 3 ms}", "{end_time: -3 ms}", "experiments.fast.scene.end_time"),
        ("{end_time: 3 ms}", "3 ms", "experiments.fast.scene"),
        ("sieve.csv", "none.csv", "experiments.slow.data.0.file"),
        ("time: 2 ms", "time: 20 ms", "experiments.slow.data.0.time"),
        ("  faster:", "  density:", "experiments.density"),
        ("  faster:", "  restitution:", "experiments.restitution"),
        ("  faster:", "  Faster:", "experiments.Faster"),
        ("  faster: {", "  faster: {date: 1, ", "experiments.faster.date"),
        ("density: 2000", "density: 2000 m", "variables.density"),
        ("{law: misfit}", "{law: maximum_growth}", "objective.law"),
        ("samples: 6}", "samples: 6, volumes: [2]}", "final.volumes"),
        ("stopping:", "output: {final_particles: true}\nstopping:", "output.final_particles"),
        ("stopping:", "output: {census: [6 ms]}\nstopping:", "output.census.0"),
        ("stopping:", "constraints: ['density < 3000']\nstopping:", "constraints"),
        ("stopping:", "data: []\nstopping:", "data"),
        ("stopping: {generations: 3}\n", "", "stopping"),
    ],
)
def test_errors_name_the_field_of_the_experiment(tmp_path, old, new, field):
    path = write_experiments(tmp_path, edit=(old, new))
    with pytest.raises(CampaignError) as caught:
        load_campaign(path)
    [problem] = caught.value.problems
    assert problem.field.startswith(field)
    key, lines = field.split(".")[1 if field.startswith("experiments") else 0], path.read_text()
    at = [i for i, line in enumerate(lines.splitlines(), 1) if f"{key}:" in line]
    assert problem.line >= (at[0] if at else 1)


@pytest.mark.parametrize("experiments", ["  slow:\n  fast:\n", FASTER])
def test_some_experiment_must_have_data(tmp_path, experiments):
    with pytest.raises(CampaignError) as caught:
        load_campaign(write_experiments(tmp_path, experiments))
    assert [problem.field for problem in caught.value.problems] == ["experiments"]


def test_what_all_experiments_lack_is_reported_once(tmp_path):
    path = write_experiments(tmp_path, density=("  density: 2000\n", ""))
    with pytest.raises(CampaignError) as caught:
        load_campaign(path)
    assert [problem.field for problem in caught.value.problems] == ["variables.density"]


def test_a_range_that_every_experiment_replaces_is_refused(tmp_path):
    shared = ("  density: 2000", "  density: 2000\n  relative_speed: [1, 2]")
    with pytest.raises(CampaignError) as caught:
        load_campaign(write_experiments(tmp_path, shared=shared))
    assert [problem.field for problem in caught.value.problems] == ["variables.relative_speed"]


def test_a_range_of_a_fraction_within_an_experiment_is_one_of_the_size_ratio(tmp_path):
    text = THREE.replace("{relative_speed: 0.5 m/s}", "{relative_speed: 1, RATIO}")
    fraction = text.replace("RATIO", "volume_fraction: [0.1, 0.2]")
    with pytest.raises(CampaignError) as caught:
        load_campaign(write_experiments(tmp_path, fraction))
    [problem] = caught.value.problems
    assert problem.field == "experiments.faster.variables.volume_fraction"
    ratio = text.replace("RATIO", "size_ratio: [0.4, 0.5]")
    found = load_campaign(write_experiments(tmp_path, ratio))
    assert "faster.size_ratio" in found.variables.searched


def test_one_scene_is_needed_where_samples_are_simulated_by_hand(campaign):
    for simulate in (campaign.simulate, campaign.estimate, campaign.simulate_many):
        with pytest.raises(CampaignError, match="slow, fast, faster"):
            simulate({})
    with pytest.raises(CampaignError, match="slow, fast, faster"):
        campaign.experiment("medium")


def with_start(folder, speed):
    start = f"search: {{start: [{{fast.relative_speed: {speed}}}], "
    return load_campaign(write_experiments(folder, start=("search: {", start)))


def test_given_strings_name_the_variables_of_experiments(tmp_path):
    assert with_start(tmp_path, "0.2 m/s").given_strings()[0, -1] == 0.2
    with pytest.raises(CampaignError) as caught:
        with_start(tmp_path, "1 m/s")
    assert [p.field for p in caught.value.problems] == ["search.start.0.fast.relative_speed"]
