"""What to measure next, of a linear problem and of a small campaign's data."""

import math

import numpy as np
import pytest
from campaign_runs import finish
from experiment_runs import write_experiments
from toy_posteriors import correlated, linear_emulator, measurements

from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference import candidate_data, next_measurement, stored_samples
from agglom_mpi.inference import posterior as posterior_module
from agglom_mpi.inference.data_posterior import PosteriorError, data_posterior, posterior_of
from agglom_mpi.inference.next_measurement import dense_points, next_measurements
from agglom_mpi.inference.stored_samples import string_values
from agglom_mpi.inference.telling_apart import telling_measurements
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.storage.reader import read_campaign

SLOPES = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
ERRORS = np.array([0.05, 0.06, 0.08])
TRUTH = np.array([0.45, 0.55])


@pytest.fixture(scope="module")
def toy(tmp_path_factory):
    """Return the posterior of three data that are linear in the place in the unit square."""
    data = measurements(1.0 + SLOPES @ TRUTH, ERRORS)
    folder = tmp_path_factory.mktemp("toy")
    return single_threaded(posterior_of)(linear_emulator(folder, SLOPES, data, noise=1e-3))


def ellipse(precision):
    """Return the area of the region with 90 % of a normal distribution in the plane."""
    return math.pi * 4.605 / math.sqrt(np.linalg.det(precision))


def test_points_along_the_axes_of_the_posterior_fill_its_region(toy):
    strings, points = dense_points(toy.of, toy)
    assert points.volume == pytest.approx(toy.volume, rel=0.1)
    assert points.volume / points.share > 0.5 * next_measurement.REGION_POINTS
    assert len(strings) == len(points.weights)
    expected = ellipse(SLOPES.T @ np.diag(ERRORS**-2.0) @ SLOPES)
    assert points.volume == pytest.approx(expected, rel=0.05)


def test_repetitions_with_half_of_the_error_leave_what_least_squares_leave(toy, monkeypatch):
    monkeypatch.setattr(next_measurement, "_new_quantities", lambda *_: ())
    found = next_measurements(None, toy.of, toy)
    left = {each.name: each.after for each in found.ranked}
    for i in range(len(ERRORS)):
        weights = ERRORS**-2.0
        weights[i] *= 1.0 + next_measurement.REPEATED_ERROR**-2
        expected = ellipse(SLOPES.T @ np.diag(weights) @ SLOPES)
        assert left[f"number {i}, again"].value == pytest.approx(expected, rel=0.05)
    means = [each.after.value for each in found.ranked]
    assert means == sorted(means)
    assert max(means) < found.volume


def test_a_repetition_of_a_correlated_datum_has_errors_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setattr(next_measurement, "_new_quantities", lambda *_: ())
    correlations = np.array([[1.0, 0.7, 0.0], [0.7, 1.0, -0.2], [0.0, -0.2, 1.0]])
    data = correlated(measurements(1.0 + SLOPES @ TRUTH, ERRORS), correlations)
    toy = single_threaded(posterior_of)(linear_emulator(tmp_path, SLOPES, data, noise=1e-3))
    found = next_measurements(None, toy.of, toy)
    precision = np.linalg.inv(correlations * np.outer(ERRORS, ERRORS))
    for each in found.ranked:
        i = int(each.name.split()[1].rstrip(","))
        again = precision.copy()
        again[i, i] += (next_measurement.REPEATED_ERROR * ERRORS[i]) ** -2.0
        expected = ellipse(SLOPES.T @ again @ SLOPES)
        assert each.after.value == pytest.approx(expected, rel=0.05)


@pytest.fixture(scope="module")
def few_strings(measured_file):
    """Return the posterior of a small campaign, whose few strings are taken for enough."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stored_samples, "MIN_STRINGS", 5)
        return data_posterior(read_campaign(measured_file))


@pytest.fixture
def measured(few_strings, monkeypatch):
    """Return that posterior, used also where so few strings seem to miss the data."""
    monkeypatch.setattr(posterior_module, "IMPOSSIBLE", 0.0)
    return few_strings


def test_a_campaign_ranks_all_it_can_measure_and_repetitions(measured):
    table = measured.what_to_measure_next({"d90": "3%", "d43": "2 um"})
    assert table["expected_volume"].is_monotonic_increasing
    assert table["measurement"].is_unique
    again = table[table["repeats"]]
    assert len(again) == 3
    assert set(table["time"]) == {2e-3, math.inf}
    assert "temperature" not in set(table["quantity"])  # the scene has no heat
    # What is measured already is not new.
    new = table[~table["repeats"]]
    assert not ((new["quantity"] == "particles_left") & (new["time"] == math.inf)).any()
    d90 = new[new["quantity"] == "d90"]
    assert d90["error"].to_numpy() == pytest.approx(0.03 * d90["predicted"].to_numpy())
    assert set(new[new["quantity"] == "d43"]["error"]) == {2e-6}
    # The mean diameter of 130 µm has an error of 3 µm.
    d50 = new[new["quantity"] == "d50"]
    assert d50["error"].to_numpy() == pytest.approx(3.0 / 130.0 * d50["predicted"].to_numpy())
    volume = table["volume"].iloc[0]
    assert (table["expected_volume"] > 0.0).all()
    slack = 5.0 * table["standard_error"] + 0.01 * volume
    assert (table["expected_volume"] < volume + slack).all()
    assert table.attrs["units"]["time"] == "s"


@pytest.fixture
def three_experiments(tmp_path, monkeypatch):
    """Return the posterior of three experiments, of which the last, `faster`, has no data."""
    monkeypatch.setattr(stored_samples, "MIN_STRINGS", 5)
    monkeypatch.setattr(posterior_module, "IMPOSSIBLE", 0.0)
    write_experiments(tmp_path)
    finish(tmp_path, "experiments.yaml")
    return data_posterior(read_campaign(tmp_path / "experiments.h5"))


@pytest.mark.slow(guard="inference/test_candidate_data.py")
def test_pairs_of_experiment_and_measurement_are_ranked_also_without_data(three_experiments):
    table = three_experiments.what_to_measure_next({"d90": "3%"})
    assert table["expected_volume"].is_monotonic_increasing
    assert table["measurement"].is_unique
    assert all(row.measurement.startswith(f"{row.experiment}: ") for row in table.itertuples())
    own = dict(list(table.groupby("experiment")))
    assert {name: rows["repeats"].sum() for name, rows in own.items()} == {
        "slow": 2,
        "fast": 1,
        "faster": 0,
    }
    # Each has censuses at the times of its own data alone, and at the end.
    assert {name: set(rows["time"]) for name, rows in own.items()} == {
        "slow": {2e-3, math.inf},
        "fast": {math.inf},
        "faster": {math.inf},
    }
    # What one of them has measured is new in another one.
    new = {n: rows[~rows["repeats"] & (rows["time"] == math.inf)] for n, rows in own.items()}
    for quantity, known in (("mean_diameter", "slow"), ("particles_left", "fast")):
        by_number = {n: rows[rows["weight"].isin(["", "number"])] for n, rows in new.items()}
        measurable = {n for n, rows in by_number.items() if quantity in set(rows["quantity"])}
        assert measurable == {*own} - {known}
    d90 = table[table["quantity"] == "d90"]
    assert d90["error"].to_numpy() == pytest.approx(0.03 * d90["predicted"].to_numpy())


def test_the_order_of_candidates_does_not_matter(measured, monkeypatch):
    two = [
        Datum.of_value("d43", 1.0, 1.0, "number", None, "d43"),
        Datum.of_value("spread", 1.0, 1.0, "number", None, "spread"),
    ]
    found = []
    for order in (two, two[::-1]):
        monkeypatch.setattr(candidate_data, "quantities_to_measure", lambda *_, o=order: o)
        found.append({each.name: each.after for each in measured.next_measurements().ranked})
    for name in ("d43", "spread"):
        assert found[0][name].value == pytest.approx(found[1][name].value, rel=1e-6)


def test_what_no_string_changes_tells_two_laws_apart_and_a_law_not_from_itself(
    measured, monkeypatch
):
    new = [
        Datum.of_value(name, 1.0, 1.0, "number", None, name)
        for name in ("d43", "spread", "particles_left")
    ]
    constants = iter((0.2, 0.3))

    def with_constant(*words):
        found = string_values(*words)
        found.values[:, -1] = next(constants)
        return found

    monkeypatch.setattr(candidate_data, "quantities_to_measure", lambda *_: new)
    monkeypatch.setattr(next_measurement, "string_values", with_constant)
    best, *others = telling_measurements((measured, measured), 0.0)
    assert best.name == "particles_left"
    assert (best.predicted, best.other_predicted) == (0.2, 0.3)
    assert best.apart.is_worth_it
    # Both laws have the larger error: the ratio is that of two normal densities.
    error = best.error.at(0.3)
    assert best.standard_error == pytest.approx(error)
    assert best.apart.log_bayes_factor == pytest.approx(0.5 * (0.1 / error) ** 2, rel=0.3)
    assert {each.name for each in others if not each.repeats} == {"d43", "spread"}
    for each in others:
        assert each.apart.doubt == pytest.approx(0.5)
        assert not each.apart.is_worth_it


def test_an_impossible_error_is_refused_with_its_quantity(measured):
    with pytest.raises(ArgumentError, match=r"errors.*d95"):
        measured.what_to_measure_next({"d95": "3%"})


def test_nothing_is_said_of_what_to_measure_next_where_no_string_fits(few_strings, monkeypatch):
    monkeypatch.setattr(posterior_module, "IMPOSSIBLE", math.nextafter(few_strings.p_value, 1.0))
    with pytest.raises(PosteriorError, match="is not known before"):
        few_strings.what_to_measure_next()


def test_a_posterior_without_a_file_has_no_further_measurements(toy):
    with pytest.raises(PosteriorError):
        toy.what_to_measure_next()
