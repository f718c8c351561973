"""What may be measured next, and how well."""

import math

import pytest
from experiment_runs import write_experiments

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.inference.candidate_data import (
    assumed_error,
    new_data,
    quantities_to_measure,
    read_errors,
    repeated,
)
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.measurements.quantities import QUANTITIES, AssumedError, MeasuredQuantity

TIMES = 2e-3, None
TEMPERATURE = Datum.of_value("temperature", 400.0, 3.0)
MEDIAN = Datum.of_value("d50", 1e-4, 4e-6, "mass", 2e-3)


def names(data):
    return [datum.name for datum in data]


def test_every_quantity_of_one_number_can_be_measured_at_every_time():
    found = quantities_to_measure(TIMES, (), has_heat=True)
    assert len(set(names(found))) == len(found)
    assert {datum.time for datum in found} == set(TIMES)
    # A mean radius is half of a mean diameter, and what files hold is no number.
    assert {datum.quantity for datum in found} == set(QUANTITIES) - {
        "sizes",
        "mean_radius",
        "restitution",
    }
    assert sum(datum.quantity == "d90" for datum in found) == 3 * len(TIMES)


def test_temperature_is_no_candidate_without_heat():
    found = quantities_to_measure(TIMES, (), has_heat=False)
    assert found
    assert all(datum.quantity != "temperature" for datum in found)


def test_what_is_measured_is_not_new_but_other_times_and_weights_are():
    whole = names(quantities_to_measure(TIMES, (), has_heat=True))
    left = names(quantities_to_measure(TIMES, (TEMPERATURE, MEDIAN), has_heat=True))
    assert set(whole) - set(left) == {"temperature at the end", "d50 by mass at 2 ms"}


@pytest.mark.parametrize(
    ("quantity", "weight", "known"),
    [
        ("mean_radius", "number", "mean_diameter by number at the end"),
        ("mean_radius", "area", "d32 at the end"),
        ("mean_diameter", "mass", "d43 at the end"),
        ("d43", "mass", "d43 at the end"),
    ],
)
def test_what_is_measured_under_another_name_is_not_new(quantity, weight, known):
    measured = Datum.of_value(quantity, 1e-4, 1e-6, weight)
    left = quantities_to_measure(TIMES, [measured], has_heat=True)
    assert set(names(quantities_to_measure(TIMES, (), has_heat=True))) - set(names(left)) == {known}


def test_each_experiment_is_measured_at_its_own_times_also_without_data(tmp_path):
    campaign = load_campaign(write_experiments(tmp_path))
    found = new_data(campaign, campaign.census, campaign.data)
    times = {"slow": {2e-3, None}, "fast": {None}, "faster": {None}}
    of = {name: [each for each in found if each.experiment == name] for name in times}
    assert sum(map(len, of.values())) == len(found)
    assert {name: {each.time for each in own} for name, own in of.items()} == times
    new = {name: names(own) for name, own in of.items()}
    mean, left = "mean_diameter by number at the end", "particles_left at the end"
    for quantity, known in ((mean, "slow"), (left, "fast")):
        assert {name for name in new if f"{name}: {quantity}" in new[name]} == {*new} - {known}
    # One of an experiment without data has all there are.
    assert len(new["faster"]) == len(quantities_to_measure((None,), (), has_heat=False))


def test_repetition_has_half_of_the_error():
    again = repeated(MEDIAN)
    assert math.sqrt(again.covariance[0, 0]) == pytest.approx(2e-6)
    assert again.values == MEDIAN.values
    assert again.name != MEDIAN.name


def test_errors_are_those_of_the_same_kind_unless_they_are_stated():
    data = TEMPERATURE, MEDIAN, Datum.of_value("d90", 2e-4, 4e-6)
    assert assumed_error("d32", data, {}) == (pytest.approx(0.03), True)  # of 4 and 2 %
    assert assumed_error("temperature", data, {}) == (3.0, False)
    assert assumed_error("spread", data, {}) == MeasuredQuantity.assumed_error
    assert assumed_error("temperature", (), {}).is_relative is False
    stated = {"d32": AssumedError(1e-6, is_relative=False)}
    assert assumed_error("d32", data, stated).at(5e-4) == 1e-6
    assert assumed_error("d43", data, stated).at(5e-4) == pytest.approx(0.03 * 5e-4)


def test_errors_are_read_with_percent_and_units():
    found = read_errors({"d90": "3%", "d10": "5 um", "temperature": 2})
    assert found["d90"] == (pytest.approx(0.03), True)
    assert found["d10"] == (pytest.approx(5e-6), False)
    assert found["temperature"] == (2.0, False)
    assert read_errors(None) == {}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("d95", "3%"),
        ("sizes", "3%"),
        ("d90", "0%"),
        ("d90", "120%"),
        ("d90", "5 kg"),
        ("d90", -1e-6),
        ("temperature", "3 degC"),
        ("spread", None),
        ("spread", "much"),
    ],
)
def test_impossible_errors_are_refused_with_the_name_of_the_quantity(name, value):
    with pytest.raises(ValueError, match=f"^{name}: "):
        read_errors({name: value})


def test_errors_are_shown_in_units_that_suit_them():
    assert AssumedError(0.05, is_relative=True).text("m") == "5 %"
    assert AssumedError(4.5e-6, is_relative=False).text("m") == "4.5 µm"
    assert AssumedError(0.01, is_relative=False).text("K") == "0.01 K"
