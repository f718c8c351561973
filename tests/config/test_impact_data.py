"""Entries of `data` with impacts: what a campaign keeps of them, and what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import campaign_of_record, check_campaign, load_campaign
from agglom_mpi.config.yaml_source import CampaignError

JOBS = Path(__file__).parents[2] / "jobs"

TEXT = """\
scene: {particles: 2, grain_radius: 1 mm, velocities: uniform_x, restitution: RESTITUTION,
  heating: none, end_time: 1 us}
variables: {relative_speed: [0.1, 1], volume_fraction: 0.01, density: 2500}
data:
  - {quantity: restitution, file: i.csv, error: 0.02}
objective: misfit
ensemble: {rule: fixed, samples: 1}
stopping: {generations: 1}
"""
LAW = "{law: constant, value: 0.7}"
IMPACTS = "speed (m/s);radius (mm);radius 2 (mm);coefficient\n1;1;wall;0.9\n2;1;2;0.8\n"


def write(folder, old="", new="", law=LAW):
    (folder / "i.csv").write_text(IMPACTS)
    path = folder / "c.yaml"
    path.write_text(TEXT.replace("RESTITUTION", law).replace(old or "\0", new))
    return path


def test_impacts_are_one_datum_with_independent_errors(tmp_path):
    [datum] = load_campaign(write(tmp_path)).data
    assert datum.values.tolist() == [0.9, 0.8]
    assert datum.covariance == pytest.approx(4e-4 * np.eye(2))
    assert datum.impacts[:, :3].tolist() == [[1.0, 1e-3, 1e3], [2.0, 1e-3, 2e-3]]
    assert datum.kind.is_exact


def test_a_stored_campaign_needs_no_file(tmp_path):
    loaded = load_campaign(write(tmp_path))
    identity = json.loads(json.dumps(loaded.identity()))
    stored = campaign_of_record(loaded.text, "stored", identity)
    assert stored.identity() == loaded.identity()
    assert np.array_equal(stored.data[0].impacts, loaded.data[0].impacts, equal_nan=True)
    with pytest.raises(CampaignError, match=r"data\.0\.file"):
        Campaign.from_text(loaded.text)


@pytest.mark.parametrize(
    ("key", "value"), [("speeds", "1.0"), ("coefficients", "0.9 7.0"), ("errors", None)]
)
def test_damaged_numbers_of_a_stored_campaign_are_noticed(tmp_path, key, value):
    loaded = load_campaign(write(tmp_path))
    identity = loaded.identity() | {f"data.0.{key}": value}
    with pytest.raises(CampaignError, match=r"data\.0\.file"):
        campaign_of_record(loaded.text, "stored", identity)


REFUSED = {
    "no file": ("file: i.csv, ", "", "file"),
    "no error": (", error: 0.02", "", "error"),
    "an error of 0": ("error: 0.02", "error: 0", "error"),
    "an error of 1": ("error: 0.02", "error: 1", "error"),
    "a value": ("error: 0.02", "error: 0.02, value: 0.9", "value"),
    "a time": ("error: 0.02", "error: 0.02, time: 1 us", "time"),
    "a weight": ("error: 0.02", "error: 0.02, weight: mass", "weight"),
    "a column": ("error: 0.02", "error: 0.02, column: coefficient", "column"),
    "counted grains": ("error: 0.02", "counted: 100, error: 0.02", "counted"),
    "another file": ("i.csv", "j.csv", "file"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_named_with_line_and_field(tmp_path, name):
    old, new, field = REFUSED[name]
    with pytest.raises(CampaignError) as caught:
        check_campaign(write(tmp_path, old, new))
    [problem] = caught.value.problems
    assert (problem.line, problem.field) == (5, f"data.0.{field}")


@pytest.mark.parametrize("step", [1, -1])
def test_impacts_are_correlated_with_nothing(tmp_path, step):
    entries = [
        "{quantity: restitution, file: i.csv, error: 0.02}",
        "{quantity: d43, value: 2 mm, error: 5%}",
    ]
    both = "\n  - ".join(entries[::step])
    correlations = "correlations: [{between: [restitution, d43], value: 0.5}]"
    path = write(tmp_path, entries[0], f"{both}\n{correlations}".replace("\ncorr", "\ncorr"))
    with pytest.raises(CampaignError, match="is 'restitution', impacts; must be data of one"):
        check_campaign(path)


def test_values_of_a_file_are_refused_with_its_line(tmp_path):
    path = write(tmp_path)
    (tmp_path / "i.csv").write_text(IMPACTS.replace("0.8", "80"))
    with pytest.raises(CampaignError) as caught:
        check_campaign(path)
    [problem] = caught.value.problems
    assert (problem.line, problem.field) == (5, "data.0.file")
    assert "line 3, column 'coefficient': '80'" in problem.message


@pytest.mark.parametrize(
    "law",
    [
        "{law: constant, value: 0}",
        "{law: adhesive, youngs_modulus: 1 GPa, dry: {law: constant, value: 0}}",
    ],
)
def test_a_law_without_restitution_is_refused(tmp_path, law):
    path = write(tmp_path, "density: 2500", "density: 2500, surface_energy: 1", law)
    with pytest.raises(CampaignError) as caught:
        check_campaign(path)
    problem = caught.value.problems[0]
    assert (problem.line, problem.field) == (5, "data.0.quantity")
    assert "constant restitution of 0" in problem.message


def test_a_check_draws_the_law_of_the_middle_beside_the_data(tmp_path):
    """A constant 0.7 of a width of 50 is in column 35, as are data of the same value."""
    path = write(tmp_path)
    (tmp_path / "i.csv").write_text(IMPACTS.replace("0.8", "0.7"))
    campaign = load_campaign(path)
    rows = [line for line in campaign.describe().splitlines() if line.rstrip().endswith("0.700")]
    first, second = (line.split("|")[1] for line in rows)
    assert (first.index("+"), first.index("o"), second.index("*")) == (35, 45, 35)
    assert [float(line.split()[0]) for line in rows] == [1.0, 2.0]
    assert "suffices" in campaign.describe()
    assert campaign.description()["data"]


def test_a_campaign_of_impacts_has_one_census_at_the_end(tmp_path):
    assert load_campaign(write(tmp_path)).census.times == (np.inf,)
    other = "data:\n  - {quantity: d43, value: 2 mm, error: 1 um, time: 0.5 us}"
    assert load_campaign(write(tmp_path, "data:", other)).census.times == (5e-7,)


@pytest.mark.parametrize(
    ("job", "variable", "best", "most"),
    [
        ("croquet_ball", "restitution.dissipative_constant", 37.91e-6, 0.008),
        ("ice", "restitution.yield_pressure", 3.605e6, 0.0135),
    ],
)
def test_the_published_impacts_are_as_near_to_their_laws_as_the_readme_says(
    job, variable, best, most
):
    loaded = load_campaign(JOBS / "impacts" / f"{job}.yaml")
    tests = loaded.impact_tests_at(loaded.parameters({variable: best}))
    away = tests.coefficients(loaded.data[0].impacts) - loaded.data[0].values
    assert np.abs(away).max() < most
    assert not loaded.warnings()
