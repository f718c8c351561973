"""What is known of numbers of the scene: sets, posteriors and sensitivities by their paths."""

import numpy as np
import pytest
from campaign_runs import assert_sound, finish
from path_campaigns import HOT, HOT_VARIABLES, text_of

from agglom_mpi.analysis.sensitivity import sensitivity_of
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.planning.workload import read_recorded_samples
from agglom_mpi.storage.reader import read_campaign

pytestmark = pytest.mark.slow(guard="inference/test_feasible_set.py")

NAMES = ("relative_speed", "contact_area.initial", "duration.length_ratio")
TEXT = (
    text_of(
        HOT | {"cooling": "none"},
        HOT_VARIABLES
        | {
            "relative_speed": "[5, 60]",
            "duration.length_ratio": "[0.2, 2, log]",
            "contact_area.initial": "[0, 0.2]",
        },
        more="final: none\n",
    )
    .replace("{population: 8, parents: 4}", "{method: surrogate, initial: 24, batch: 12}")
    .replace("ratio: 1.5", "ratio: 1.3")
    .replace("generations: 3", "generations: 6")
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the file of a campaign that a surrogate searched."""
    folder = tmp_path_factory.mktemp("sets")
    (folder / "sets.yaml").write_text(TEXT)
    finish(folder, "sets.yaml", "-q")
    assert_sound(folder / "sets.h5")
    return folder / "sets.h5"


@pytest.fixture(scope="module")
def found(run):
    return open_campaign(run).feasible_set()


def test_a_set_is_of_the_variables_by_their_paths(found):
    assert tuple(each.name for each in found.variables) == NAMES
    values = {"relative_speed": 30.0, "duration.length_ratio": [0.25, 1.9]}
    probability = found.probability(values | {"contact_area.initial": 0.1})
    assert probability.shape == (2,)
    assert ((probability >= 0.0) & (probability <= 1.0)).all()
    with pytest.raises(CampaignError, match=r"contact_area\.initial"):
        found.probability(values)


def test_two_grains_bond_below_a_pressure_so_that_speed_and_duration_rise_together(found):
    """The critical speed is √(H a_f/(ρ Δ)): faster collisions are as sticky in longer contacts."""
    draws = found.posterior(1.3, 0.03).draws
    assert set(NAMES) <= set(draws.columns)
    logarithms = np.log(draws[["relative_speed", "duration.length_ratio"]].to_numpy())
    weights = draws["weight"].to_numpy()
    covariance = np.cov(logarithms.T, aweights=weights)
    assert covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]) > 0.5


def test_sensitivities_are_by_path(run):
    names, indices = sensitivity_of(read_campaign(run))
    assert names == NAMES
    assert indices is not None
    assert indices.total.shape == (3,)


def test_a_forecast_takes_samples_of_the_same_variables(run):
    samples = read_recorded_samples(str(run), Campaign.from_text(TEXT))
    assert samples.parameters.shape[1] == 12
    other = TEXT.replace("  contact_area.initial: [0, 0.2]\n", "")
    with pytest.raises(CampaignError, match=r"contact_area\.initial"):
        read_recorded_samples(str(run), Campaign.from_text(other))
