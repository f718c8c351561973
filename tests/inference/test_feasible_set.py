import re

import numpy as np
import pytest
from campaign_runs import finish
from set_runs import calibrated, three_variable_file, three_variable_text

from agglom_mpi import open_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.feasible_set import FeasibleSet, NoFeasibleSetError
from agglom_mpi.inference.set_directions import MIN_FREE_SHARE, _slopes
from agglom_mpi.search.criteria import DRAWN_FUNCTIONS
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.verbs.estimate import estimate

MEMBER = {"relative_speed": 4.3, "hardness": 67e6, "friction": 0.3}
"""Near the first row of [A] table 1, which doubles the grains."""


def test_members_are_likely_and_others_are_not(doubling):
    speeds = np.array([0.5, 4.3, 25.0])
    found = doubling.probability(MEMBER | {"relative_speed": speeds})
    assert found.shape == (3,)
    assert found[1] > 0.5
    assert found[[0, 2]].max() < 0.05  # the usual level, by an emulator of few samples


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
    simulated = estimate(doubling.emulated.box.campaign, MEMBER, samples=200).mean_radius_ratio
    error = np.hypot(simulated.error, doubling.deviation(MEMBER)[0])
    assert abs(doubling.mean(MEMBER)[0] - simulated.value) < 4.0 * error
    # The standard deviation of a standard deviation of 200 values, and what 240 samples say of it.
    noise = simulated.error * np.sqrt(200)
    assert doubling.noise(MEMBER)[0] == pytest.approx(noise, rel=0.5)


def test_inner_and_outer_set_enclose_the_volume(doubling):
    assert 0.0 < doubling.inner < doubling.volume < doubling.outer < 0.2
    assert 0.0 < doubling.volume_error < doubling.volume
    assert 0.0 < doubling.expected_error < 1.0


@pytest.mark.slow
def test_the_error_of_the_volume_is_the_spread_of_drawn_functions(doubling):
    """All points are asked, without the noise of points, whose own share is below a tenth here.

    That the volume lies between those of the inner and the outer set is tested quickly.

    Functions drawn together are sums of the same random waves, so that their spread differs between
    draws by more than their number says.
    """
    points, emulated = doubling.points, doubling.emulated
    at = emulated.coordinates.of_strings(points.strings)
    streams = map(np.random.default_rng, range(12))
    draws = [emulated.emulator.draw(DRAWN_FUNCTIONS, stream) for stream in streams]
    spreads = [(doubling.criterion.holds(drawn(at)) @ points.weights).std() for drawn in draws]
    middle, error = np.mean(spreads), np.std(spreads, ddof=1) * np.sqrt(1.0 + 1.0 / len(spreads))
    assert abs(doubling.volume_error - middle) < 4.0 * error + 0.1 * middle


def test_speed_and_hardness_decide_as_the_impact_pressure(doubling):
    directions = doubling.directions
    assert directions["share"][0] > 0.98
    assert directions["group"][0] == "ρv²/H"
    assert directions["relative_speed"][0] == pytest.approx(1.0)
    assert directions["hardness"][0] == pytest.approx(-0.5, abs=0.15)
    kept = {v.name: v.kept for v in doubling.variables}
    assert kept["friction"] > 2.0 * max(kept["relative_speed"], kept["hardness"])
    assert all(v.free == (v.kept >= MIN_FREE_SHARE) for v in doubling.variables)


def test_a_set_that_goes_on_at_the_end_of_a_range_touches_it(doubling):
    [hardness] = [v for v in doubling.variables if v.name == "hardness"]
    [speed] = [v for v in doubling.variables if v.name == "relative_speed"]
    assert "upper" in hardness.touches
    assert speed.touches == ()


def test_a_wider_tolerance_makes_a_larger_set(three, doubling):
    assert three.feasible_set(0.1).volume > 1.5 * doubling.volume


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"relative_speed": 4.0, "hardness": 6e7}, "friction: "),
        (MEMBER | {"speed": 4.0}, "speed: .*'relative_speed'"),
        (MEMBER | {"friction": [[0.1], [0.2]]}, r"friction: .*\(2, 1\)"),
        (MEMBER | {"friction": [0.1, np.nan]}, "friction: .*nan"),
        (MEMBER | {"hardness": "60 m/s"}, "hardness: .*'m/s'"),
        (MEMBER | {"density": 5000.0}, "density: .*5000.*6141.898"),
        (MEMBER | {"friction": [0.1, 0.2], "hardness": [6e7] * 3}, "hardness 3, friction 2"),
        (np.zeros(9), "parameters: .*"),
        (7.0, "parameters: .*"),
        ("fast", "parameters: .*str"),
    ],
)
def test_wrong_parameters_are_named(doubling, parameters, said):
    with pytest.raises(CampaignError, match=said):
        doubling.probability(parameters)


def test_texts_with_units_are_the_numbers_that_simulate_takes_them_for(doubling):
    texts = {"relative_speed": "430 cm/s", "hardness": ["67 MPa", "0.1 GPa"], "friction": 0.3}
    numbers = MEMBER | {"hardness": np.array([67e6, 1e8])}
    assert doubling.probability(texts) == pytest.approx(doubling.probability(numbers), abs=1e-12)
    strings = [
        doubling.emulated.box.campaign.parameters(MEMBER | {"hardness": h}) for h in (67e6, 1e8)
    ]
    assert np.array_equal(doubling.mean(strings), doubling.mean(numbers))


def test_the_campaign_names_its_variables(half):
    names = ["relative_speed", "volume_fraction", "hardness", "friction"]
    members = half.sample(20, seed=1)
    assert list(members) == [*names, "probability"]
    assert members["volume_fraction"].between(0.1, 0.3).all()
    assert [each.name for each in half.variables] == names
    assert half.variables[1].lower == pytest.approx(0.1)
    assert half.variables[1].upper == pytest.approx(0.3)
    own = half.probability(members[names])
    assert own == pytest.approx(members["probability"].to_numpy())
    ratio = (6.0 * members["volume_fraction"] / np.pi) ** (1.0 / 3.0)
    by_ratio = members[names].drop(columns="volume_fraction").assign(size_ratio=ratio)
    assert half.probability(by_ratio) == pytest.approx(own, rel=1e-6, abs=1e-9)
    with pytest.raises(CampaignError, match="volume_fraction: "):
        half.probability(members[names].drop(columns="volume_fraction"))


def test_exponents_are_those_of_the_named_variables(half):
    """φ ~ l³, so that l^p is φ^(p/3)."""
    slopes = _slopes(half.emulated, half.points)
    along = np.linalg.eigh(slopes.T @ slopes)[1][:, -1] / half.emulated.coordinates.spans
    [row, *_] = half.directions.to_dict("records")
    wanted = along[1] / 3.0 / along[0]
    assert row["volume_fraction"] / row["relative_speed"] == pytest.approx(wanted)
    assert row["hardness"] / row["relative_speed"] == pytest.approx(along[2] / along[0])


@pytest.mark.parametrize("tolerance", [-1, 0, 5, 1.0, np.nan, np.inf, True, None, "wide", "-5%"])
def test_a_tolerance_is_a_fraction(three, tolerance):
    with pytest.raises(ValueError, match="tolerance: "):
        three.feasible_set(tolerance)


def test_a_tolerance_that_is_too_large_may_be_meant_in_percent(three):
    with pytest.raises(CampaignError, match=r"tolerance: .*did you mean '5%'"):
        three.feasible_set(5)


def test_a_tolerance_in_percent_is_that_fraction(three, doubling):
    found = three.feasible_set("5%")
    assert found.tolerance == doubling.tolerance
    assert found.volume == pytest.approx(doubling.volume, rel=1e-6)


@pytest.mark.parametrize("count", [0, -1, 2.0, True, "3"])
def test_counts_are_whole_numbers(three, doubling, count):
    calls = {"k": three.best, "n": doubling.sample}
    calls["n of a posterior"] = doubling.posterior(2.0, 0.1).sample
    for field, call in calls.items():
        with pytest.raises(ValueError, match=rf"\b{field[0]}: .*{re.escape(str(count))}.*\b1\b"):
            call(count)
    with pytest.raises(ValueError, match=r"seed: .*-1"):
        doubling.sample(1, seed=-1)


def test_an_empty_set_names_the_nearest_string(unreachable):
    found = unreachable.nearest
    assert unreachable.empty
    assert found.out_of_reach
    assert found.probability < 0.05
    assert found.ends["relative_speed"] == "upper"
    assert found.parameters["relative_speed"] == pytest.approx(1.2)
    mean, deviation = found.mean["mean_radius_ratio"], found.deviation["mean_radius_ratio"]
    assert unreachable.mean(found.parameters)[0] == pytest.approx(mean)
    assert found.away == pytest.approx((1.9 - mean) / deviation)
    assert unreachable.variables == []
    assert unreachable.directions.empty
    with pytest.raises(NoFeasibleSetError, match="nearest"):
        unreachable.sample(3)


def test_no_string_of_the_box_is_nearer_than_the_nearest(unreachable):
    means = unreachable.emulated.mean(unreachable.emulated.box.even_strings(1 << 12))[:, 0]
    assert means.max() <= unreachable.nearest.mean["mean_radius_ratio"] + 1e-9


def test_what_the_emulator_is_too_unsure_to_tell_is_not_out_of_reach(three):
    narrow = single_threaded(FeasibleSet)(read_campaign(three.path), 1e-9)
    assert narrow.empty
    assert not narrow.nearest.out_of_reach


def test_the_object_says_what_it_is(doubling, unreachable, monkeypatch):
    assert "mean b/b0 1.9 to 2.1" in repr(doubling)
    assert f"{100.0 * doubling.volume:.3g} % of the box" in repr(doubling)
    monkeypatch.setattr(unreachable, "calibration", calibrated(unreachable))
    assert f"empty; nearest {unreachable.nearest}" in repr(unreachable)


def test_constraints_cut_the_set_and_their_share_is_told(tmp_path):
    path = three_variable_file(tmp_path, constraints='["relative_speed < 5 m/s"]', generations=6)
    found = open_campaign(path).feasible_set()
    # The share of [0.1, 30] below 5, by 8192 even points.
    assert found.allowed == pytest.approx(4.9 / 29.9, abs=1e-3)
    assert found.probability(MEMBER | {"relative_speed": 5.5, "hardness": 1.1e8})[0] == 0.0
    assert found.sample(50)["relative_speed"].max() < 5.0


def test_common_configurations_are_refused_with_the_reason(tmp_path):
    ensemble = "{rule: fixed, samples: 1, common_configurations: true}"
    (tmp_path / "three.yaml").write_text(
        three_variable_text(generations=2, ensemble=ensemble, final="none")
    )
    finish(tmp_path, "three.yaml")
    with pytest.raises(NoFeasibleSetError, match=r"ensemble.common_configurations"):
        open_campaign(tmp_path / "three.h5").feasible_set()


def test_too_few_strings_are_refused(tmp_path):
    path = three_variable_file(tmp_path, generations=2)
    with pytest.raises(NoFeasibleSetError, match=r"\b32\b.*\b50\b"):
        open_campaign(path).feasible_set()


def test_only_a_set_of_maximum_growth_has_a_maximum(doubling):
    with pytest.raises(NoFeasibleSetError, match=r"maximum: .*growth_target"):
        _ = doubling.maximum
