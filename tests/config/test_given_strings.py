import numpy as np
import pytest
from set_runs import three_variable_text

from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.given_strings import read_searched, read_strings
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.estimate import estimate
from agglom_mpi.verbs.simulate import simulate

TEXT = three_variable_text()
FILLED = TEXT.replace("size_ratio: 0.633", "volume_fraction: [0.1, 0.3]")


@pytest.fixture(scope="module")
def campaign():
    return Campaign.from_text(FILLED)


def test_a_variable_has_the_name_and_range_of_the_file(campaign):
    speed, fraction, hardness, _ = campaign.variables.own
    assert (speed.name, fraction.name, fraction.unit) == ("relative_speed", "volume_fraction", "1")
    assert (fraction.lower, fraction.upper) == pytest.approx((0.1, 0.3))
    assert not fraction.cubic
    assert hardness.logarithmic
    assert (hardness.power, fraction.power) == (1.0, 3.0)
    values = np.array([0.1, 0.2, 0.3])
    assert fraction.of_components(fraction.components(values)) == pytest.approx(values)


def test_values_are_read_as_simulate_reads_them(campaign):
    """One by one, and all at once."""
    speeds, hardnesses = ["1 m/s", "250 cm/s", 3.0], ["10 MPa", "2e7 Pa", "0.1 GPa"]
    fractions = np.array([0.1, 0.2, 0.3])
    together = read_strings(
        campaign, {"relative_speed": speeds, "hardness": hardnesses, "volume_fraction": fractions}
    )
    for row, values in zip(together, zip(speeds, hardnesses, fractions, strict=True), strict=True):
        names = ("relative_speed", "hardness", "volume_fraction")
        one = campaign.parameters(dict(zip(names, values, strict=True)))
        assert np.array_equal(row, one, equal_nan=True)
    assert np.array_equal(read_strings(campaign, together), together, equal_nan=True)


@pytest.mark.parametrize(
    "parameters",
    [
        {"speed": 1.0},
        {"hardness": "60 m/s"},
        {"relative_speed": -1.0},
        {"volume_fraction": 0.5},
        {"volume_fraction": 0.2, "size_ratio": 0.6},
        {"density": np.nan},
        {"temperature": True},
    ],
)
def test_a_mistake_is_named_as_simulate_names_it(campaign, parameters):
    """The same words for one value, and for that value among others."""
    with pytest.raises(CampaignError) as wanted:
        simulate(campaign, parameters)
    for given in (parameters, {name: [value, value] for name, value in parameters.items()}):
        with pytest.raises(CampaignError) as found:
            read_strings(campaign, given)
        assert str(found.value) == str(wanted.value)


@pytest.mark.parametrize(
    "values",
    [[1.0, -1.0, 2.0], [1.0, np.inf], [np.nan, 1.0], [1.0, 1e-200], [1.0, 1e200]],
)
def test_one_impossible_value_among_many_is_found(campaign, values):
    with pytest.raises(CampaignError, match="relative_speed: is "):
        read_strings(campaign, {"relative_speed": np.array(values)})


def test_no_strings_are_no_mistake(campaign):
    empty = read_strings(campaign, {"relative_speed": [], "volume_fraction": np.array([])})
    assert empty.shape == (0, 10)


def test_strings_that_simulate_refuses_are_refused(campaign):
    string = campaign.parameters()
    string[2] = np.nan
    for call in (simulate, Campaign.allowed, estimate):
        with pytest.raises(CampaignError, match="density: is nan; must be a finite number"):
            call(campaign, string)


@pytest.mark.parametrize("sample", [-1, 1.5, True, "1", None, np.nan])
def test_the_number_of_a_sample_is_a_whole_number(campaign, sample):
    with pytest.raises(ValueError, match=r"sample: is .*; must be a whole number of at least 0"):
        simulate(campaign, {}, sample)


@pytest.mark.parametrize("samples", [0, -1, 1.5, True, "9"])
def test_the_number_of_samples_is_a_whole_number(campaign, samples):
    with pytest.raises(ValueError, match=r"samples: is .*; must be a whole number of at least 1"):
        estimate(campaign, {}, samples)


def test_constraints_are_asked_by_the_names_of_the_file():
    text = FILLED + 'constraints: ["volume_fraction < 0.2", "hardness > 50 MPa"]\n'
    campaign = Campaign.from_text(text)
    found = campaign.allowed({"volume_fraction": [0.1, 0.25], "hardness": "60 MPa"})
    assert found.tolist() == [True, False]


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ("fast", "are str"),
        (None, "are NoneType of the shape"),
        (np.zeros((2, 10)), "are 2 strings; must be one"),
    ],
)
def test_what_is_no_string_is_refused(campaign, parameters, said):
    with pytest.raises(ValueError, match=f"parameters: {said}"):
        simulate(campaign, parameters)


def test_an_engine_is_named(campaign):
    with pytest.raises(ValueError, match="engine: is 5; must be event, fixed"):
        simulate(campaign, {}, engine=5)


def test_what_is_fixed_may_be_given_but_not_changed():
    campaign = Campaign.from_text(TEXT.replace("size_ratio: 0.633", "volume_fraction: 0.2"))
    searched = {"relative_speed": 4.3, "hardness": "67 MPa", "friction": 0.3}
    assert read_searched(campaign, searched | {"volume_fraction": 0.2}).shape == (1, 10)
    with pytest.raises(CampaignError, match=r"volume_fraction: is 0\.25; .* fixed it at 0\.2$"):
        read_searched(campaign, searched | {"volume_fraction": "25%"})


def test_a_volume_fraction_gives_a_size_ratio_that_is_searched():
    campaign = Campaign.from_text(TEXT.replace("size_ratio: 0.633", "size_ratio: [0.3, 0.8]"))
    searched = {"relative_speed": 4.3, "hardness": "67 MPa", "friction": 0.3}
    [filled] = read_searched(campaign, searched | {"volume_fraction": 0.1})
    [given] = read_searched(campaign, searched | {"size_ratio": (0.6 / np.pi) ** (1.0 / 3.0)})
    assert filled == pytest.approx(given, nan_ok=True)


def row(campaign, **columns):
    """Return a row of a table of strings as a mapping."""
    values = TEN.values_by_name(campaign.parameters())
    results = {"string": 3, "origin": "random", "objective": 0.5, "estimate": np.nan}
    used = {name: values[name] for name in campaign.variables.used}
    return results | used | {"volume_fraction": 0.2, "samples_used": 7} | columns


def test_a_row_of_a_table_of_strings_is_a_string(campaign):
    found = campaign.parameters(row(campaign, relative_speed=4.5))
    assert np.array_equal(found, campaign.parameters({"relative_speed": 4.5}), equal_nan=True)


@pytest.mark.parametrize("columns", [{"hardnes": 1.0}, {"relative_speed": -1.0}])
def test_a_mistake_in_a_row_is_one(campaign, columns):
    with pytest.raises(CampaignError, match=next(iter(columns))):
        campaign.parameters(row(campaign, **columns))


def test_results_without_a_string_are_unknown_variables(campaign):
    with pytest.raises(CampaignError, match="objective: unknown variable"):
        campaign.parameters({"objective": 0.5})


def test_a_row_of_the_best_strings_simulates_the_sample_that_is_recorded(shared_campaign):
    folder = shared_campaign("tiny")
    file, own = open_campaign(folder / "tiny.h5"), load_campaign(folder / "tiny.yaml")
    best = file.best(2)
    samples = file.samples.set_index(["string", "sample"])["mean_radius_ratio"]
    recorded = samples[int(best["string"][0]), 0]
    for given in (best.iloc[0], best.iloc[0].to_dict(), file.best(1)):
        assert simulate(own, given).mean_radius_ratio == recorded
    assert np.array_equal(own.allowed(best), [True, True])
    with pytest.raises(CampaignError, match="are 2 strings; must be one"):
        simulate(own, best)
