"""Samples of many strings at once are those of `simulate`, in any number of threads."""

import pickle
import signal
import threading
from pathlib import Path

import numpy as np
import pytest
from campaign_runs import HARD, SMALL, write_campaign, write_endless

from agglom_mpi import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.outcome import OUTCOME
from agglom_mpi.verbs.simulate import simulate

JOBS = Path(__file__).parents[2] / "jobs"
STRINGS = {"relative_speed": [2.0, 4.0, 8.0], "hardness": ["30 MPa", "60 MPa", 1e8]}
FUNCTION = """
def worth(sample):
    if sample.particles % 2:
        raise ArithmeticError("an odd number of particles")
    return float(sample.particles)
"""


@pytest.fixture(scope="module")
def campaign():
    return load_campaign(JOBS / "quickstart.yaml")


def assert_as_one_by_one(campaign, found, strings, first=0):
    for (i, j), failed in np.ndenumerate(found.failed):
        string = found.parameters[i]
        assert string.tobytes() == campaign.parameters(strings[i]).tobytes()
        if failed:
            with pytest.raises(RuntimeError, match=f"sample {first + j} failed: "):
                simulate(campaign, string, first + j)
            continue
        outcome = simulate(campaign, string, first + j)
        for name in set(OUTCOME.names) - {"state", "reason"}:
            assert found[name][i, j].tobytes() == outcome.record[name].tobytes(), name
        assert found.objective[i, j] == outcome.objective
        for name, value in outcome.quantities.items():
            assert found[name][i, j] == value


@pytest.mark.parametrize("workers", [1, 3, None])
def test_each_sample_is_that_of_simulate(campaign, workers):
    found = campaign.simulate_many(STRINGS, samples=4, workers=workers)
    assert found.mean_radius_ratio.shape == found.failed.shape == (3, 4)
    rows = [dict(zip(STRINGS, row, strict=True)) for row in zip(*STRINGS.values(), strict=True)]
    assert not found.failed.any()
    assert_as_one_by_one(campaign, found, rows)


def test_samples_may_begin_at_any_number(campaign):
    found = campaign.simulate_many(STRINGS, samples=2, first_sample=7)
    all_of_them = campaign.simulate_many(STRINGS, samples=9)
    assert np.array_equal(found.particles, all_of_them.particles[:, 7:])
    assert np.array_equal(found.objective, all_of_them.objective[:, 7:])


def test_strings_come_as_an_array_or_as_a_table_of_a_file(campaign):
    pd = pytest.importorskip("pandas")
    strings = campaign.simulate_many(STRINGS).parameters
    by_array = campaign.simulate_many(strings)
    by_table = campaign.simulate_many(pd.DataFrame({"string": [4, 2, 9], **STRINGS}))
    assert np.array_equal(by_array.mean_radius_ratio, by_table.mean_radius_ratio)
    assert np.array_equal(by_array.parameters, strings, equal_nan=True)
    assert campaign.simulate_many(strings[0]).failed.shape == (1, 1)
    assert campaign.simulate_many(strings[:0]).failed.shape == (0, 1)


@pytest.mark.slow(guard="verbs/test_simulate_many.py::test_each_sample_is_that_of_simulate")
def test_another_engine_is_that_of_simulate(campaign):
    found = campaign.simulate_many({"hardness": 6e7}, engine="fixed:500")
    outcome = simulate(campaign, {"hardness": 6e7}, engine="fixed:500")
    assert found.steps.tolist() == [[500]]
    assert found.mean_radius_ratio[0, 0] == outcome.mean_radius_ratio


@pytest.mark.slow(guard="verbs/test_simulate_many.py::test_each_sample_is_that_of_simulate")
@pytest.mark.parametrize("job", ["questions/fines", "questions/powder"])
def test_functions_and_sizes_are_those_of_simulate(job):
    campaign = load_campaign(JOBS / f"{job}.yaml", allow_code=True)
    found = campaign.simulate_many({"relative_speed": [0.3, 0.6]}, samples=2, workers=2)
    assert_as_one_by_one(campaign, found, [{"relative_speed": 0.3}, {"relative_speed": 0.6}])
    assert set(found.units) == set(found.columns)
    assert set(campaign.objective.quantity_units) <= set(found.columns)


@pytest.fixture
def raising(tmp_path):
    (tmp_path / "shape.py").write_text(FUNCTION)
    path = write_campaign(tmp_path / "raising.yaml", **SMALL)
    target = "objective: {law: growth_target, ratio: 2}"
    function = 'objective: {law: function, call: "shape:worth"}'
    text = path.read_text()
    assert target in text
    path.write_text(text.replace(target, function))
    return load_campaign(path, allow_code=True)


def test_a_sample_that_raises_has_failed_and_no_other(raising):
    found = raising.simulate_many({"hardness": [5e7, 8e7]}, samples=12, workers=2)
    assert 0 < found.failed.sum() < found.failed.size
    assert set(found.reasons) == set(
        zip(*map(np.ndarray.tolist, found.failed.nonzero()), strict=True)
    )
    assert all("ArithmeticError" in reason for reason in found.reasons.values())
    assert np.isnan(found.objective[found.failed]).all()
    assert (found.particles[~found.failed] % 2 == 0).all()


def test_a_string_that_a_scene_cannot_have_has_failed(campaign):
    found = campaign.simulate_many({"density": [6142.0, 1e-99]}, samples=2)
    assert found.failed.tolist() == [[False, False], [True, True]]
    assert all("density" in reason for reason in found.reasons.values())
    assert np.isfinite(found.mean_radius_ratio[0]).all()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"parameters": {"hardnes": [1e7, 2e7]}}, "hardnes: .*'hardness'"),
        ({"parameters": {"hardness": ["60 m", "60 MPa"]}}, "hardness: .*length"),
        ({"parameters": np.ones((2, 3))}, r"of the shape \(2, 3\)"),
        ({"parameters": STRINGS, "samples": 0}, "samples: is 0"),
        ({"parameters": STRINGS, "workers": 0}, "workers: is 0"),
        ({"parameters": STRINGS, "first_sample": -1}, "first_sample: is -1"),
        ({"parameters": STRINGS, "engine": "exact"}, "engine: "),
    ],
)
def test_what_is_wrong_is_named_with_its_field(campaign, arguments, expected):
    with pytest.raises(CampaignError, match=expected):
        campaign.simulate_many(**arguments)


def test_an_interrupt_ends_the_samples_under_way(tmp_path):
    write_endless(tmp_path / "endless.yaml")
    campaign = load_campaign(tmp_path / "endless.yaml")
    simulate(campaign, {"hardness": 1e7, "relative_speed": 1e-9})  # compiles
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    try:
        with pytest.raises(KeyboardInterrupt):
            campaign.simulate_many({**HARD, "relative_speed": [1.0] * 4}, samples=3, workers=2)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert not [each for each in threading.enumerate() if each.name.startswith("samples")]


def test_columns_are_attributes(campaign):
    found = campaign.simulate_many(STRINGS, samples=2)
    assert found["merges"] is found.merges
    assert {"merges", "failed", "units"} <= set(dir(found))
    assert "_run" not in dir(found)
    with pytest.raises(AttributeError, match="'merges'"):
        _ = found.merge
    with pytest.raises(KeyError, match="'merges'"):
        found["merge"]
    again = pickle.loads(pickle.dumps(found))
    assert np.array_equal(again.merges, found.merges)
    assert len(repr(found)) < 160
    assert "3 strings, 2 samples of each, 0 failed" in repr(found)
