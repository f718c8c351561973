import numpy as np
import pytest
from campaign_runs import finish
from set_runs import three_variable_file, three_variable_text

from agglom_mpi import open_campaign
from agglom_mpi.analysis.feasible_set import NoFeasibleSetError

MEMBER = {"relative_speed": 4.3, "hardness": 67e6, "friction": 0.3}
"""Near the first row of [A] table 1, which doubles the grains."""


def test_members_are_likely_and_others_are_not(doubling):
    speeds = np.array([0.5, 4.3, 25.0])
    found = doubling.probability(MEMBER | {"relative_speed": speeds})
    assert found.shape == (3,)
    assert found[1] > 0.5
    assert found[[0, 2]].max() < 0.01


def test_a_table_is_asked_as_a_mapping_is(doubling):
    members = doubling.sample(20, seed=1)
    table = doubling.probability(members.drop(columns="probability"))
    assert table == pytest.approx(members["probability"].to_numpy())
    assert (table > 0.0).all()
    assert members.attrs["units"]["hardness"] == "Pa"


def test_outside_of_the_box_nothing_is_known(doubling):
    assert np.isnan(doubling.probability(MEMBER | {"relative_speed": 31.0})).all()
    assert np.isnan(doubling.mean(MEMBER | {"friction": 0.6})).all()


def test_the_mean_is_that_of_many_samples(doubling):
    """An estimate of 200 samples, and the emulator's own deviation."""
    simulated = doubling.campaign.estimate(MEMBER, samples=200).mean_radius_ratio
    error = np.hypot(simulated.error, doubling.deviation(MEMBER)[0])
    assert abs(doubling.mean(MEMBER)[0] - simulated.value) < 4.0 * error
    # The standard deviation of a standard deviation of 200 values, and what 240 samples say of it.
    noise = simulated.error * np.sqrt(200)
    assert doubling.noise(MEMBER)[0] == pytest.approx(noise, rel=0.5)


def test_inner_and_outer_set_enclose_the_volume(doubling):
    assert 0.0 < doubling.inner < doubling.volume < doubling.outer < 0.2
    assert 0.0 < doubling.volume_error < doubling.volume
    assert 0.0 < doubling.expected_error < 1.0


def test_speed_and_hardness_decide_as_the_impact_pressure(doubling):
    directions = doubling.directions
    assert directions["share"][0] > 0.98
    assert directions["group"][0] == "ρv²/H"
    assert directions["relative_speed"][0] == pytest.approx(1.0)
    assert directions["hardness"][0] == pytest.approx(-0.5, abs=0.15)
    assert {v.name: v.free for v in doubling.variables} == {
        "relative_speed": False,
        "hardness": False,
        "friction": True,
    }


def test_a_set_that_goes_on_at_the_end_of_a_range_touches_it(doubling):
    [hardness] = [v for v in doubling.variables if v.name == "hardness"]
    [speed] = [v for v in doubling.variables if v.name == "relative_speed"]
    assert "upper" in hardness.touches
    assert speed.touches == ()


def test_a_wider_tolerance_makes_a_larger_set(three, doubling):
    assert three.feasible_set(0.1).volume > 1.5 * doubling.volume


def test_the_same_file_gives_the_same_set(three, doubling):
    assert three.feasible_set(0.05).volume == pytest.approx(doubling.volume, rel=1e-6)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"relative_speed": 4.0, "hardness": 6e7}, "friction: is missing"),
        (MEMBER | {"speed": 4.0}, "speed: unknown variable"),
        (MEMBER | {"friction": [[0.1], [0.2]]}, "one-dimensional"),
    ],
)
def test_wrong_parameters_are_named(doubling, parameters, said):
    with pytest.raises(NoFeasibleSetError, match=said):
        doubling.probability(parameters)


def test_constraints_cut_the_set_and_their_share_is_told(tmp_path):
    path = three_variable_file(tmp_path, constraints='["relative_speed < 5 m/s"]', generations=10)
    found = open_campaign(path).feasible_set()
    # The share of [0.1, 30] below 5, by 8192 even points.
    assert found.allowed == pytest.approx(4.9 / 29.9, abs=1e-3)
    assert found.probability(MEMBER | {"relative_speed": 5.5, "hardness": 1.1e8})[0] == 0.0
    assert found.sample(50)["relative_speed"].max() < 5.0


def test_common_configurations_are_refused_with_the_reason(tmp_path):
    ensemble = "{rule: fixed, samples: 1, common_configurations: true}"
    (tmp_path / "three.yaml").write_text(
        three_variable_text(generations=6, ensemble=ensemble, final="none")
    )
    finish(tmp_path, "three.yaml")
    with pytest.raises(NoFeasibleSetError, match=r"common_configurations is true; the noise"):
        open_campaign(tmp_path / "three.h5").feasible_set()


def test_too_few_strings_are_refused(tmp_path):
    path = three_variable_file(tmp_path, generations=2)
    with pytest.raises(NoFeasibleSetError, match="of 32 different strings; at least 50"):
        open_campaign(path).feasible_set()
