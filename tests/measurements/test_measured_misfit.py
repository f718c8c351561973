import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measured_samples import counted_covariance, drawn_census, expected_census
from scipy.stats import chi2, f

from agglom_mpi.measurements.datum import Datum, predictions
from agglom_mpi.measurements.misfit import misfit, sampling_noise, tail_probability

SAMPLES = [5, 20, pytest.param(100, marks=pytest.mark.slow)]
CLASSES = np.array([0.0, 1e-4, 1.3e-4, 1.7e-4, np.inf])
D43 = 1e-4 * math.exp(3.5 * 0.3**2)
D50 = 1e-4 * math.exp(3.0 * 0.3**2)
MIDDLE = np.array([0.15, 0.3, 0.33, 0.22])
"""Near the shares by mass of the drawn samples."""


def sizes(shares=MIDDLE, counted=400, time=None):
    return Datum(
        "sizes", shares, counted_covariance(shares, counted), "mass", time, CLASSES, "sieves"
    )


def several():
    return [
        sizes(),
        Datum.of_value("d43", D43, 5e-6),
        Datum.of_value("d50", D50, 5e-6, "mass"),
        Datum.of_value("particles_left", 0.5, 0.05),
        Datum.of_value("temperature", 300.0, 5.0),
    ]


def true_shares():
    """Return the shares of the law that the samples are drawn from."""
    return predictions(expected_census(1e-4, 0.3), [sizes()]).pooled


def test_one_number_has_the_misfit_by_hand():
    census = drawn_census(7, np.random.default_rng(1))
    means = census.counts.sum(axis=(1, 2)) / census.grains
    noise = float(np.var(means, ddof=1)) / 7
    result = misfit(census, [Datum.of_value("particles_left", 0.4, 0.02)])
    away = float(np.mean(means)) - 0.4
    total = 0.02**2 + noise
    assert result.value == pytest.approx((away**2 - noise) / total, rel=1e-9)
    assert result.chi_square == pytest.approx(away**2 / total, rel=1e-9)
    assert result.rank == 1
    part = result.parts[0]
    assert part.residual == pytest.approx([away])
    assert part.error == pytest.approx([math.sqrt(total)])
    assert (part.share, part.rank) == (1.0, 1)
    assert part.chi_square == pytest.approx(result.chi_square)
    assert part.p_value == pytest.approx(result.p_value)
    # Welch's degrees of freedom of a known and an estimated variance.
    freedom = 6 * (total / noise) ** 2
    assert result.p_value == pytest.approx(f.sf(result.chi_square, 1, freedom), rel=1e-9)


def test_two_numbers_with_correlated_errors_have_the_misfit_by_hand():
    """Alone each is as if there were no other; a curve beside them does not matter."""
    census = expected_census(1e-4, 0.3)
    errors, r = np.array([5e-6, 4e-6]), 0.6
    first = Datum.of_value("d43", D43 + 8e-6, errors[0])
    second = Datum.of_value("d50", D50 + 2e-6, errors[1], "mass")
    both = dataclasses.replace(second, correlations=((first, r),))
    away = predictions(census, [first, second]).pooled - [first.values[0], second.values[0]]
    u, v = away / errors
    expected = (u**2 - 2.0 * r * u * v + v**2) / (1.0 - r**2)
    for data in ([first, both], [both, first]):
        result = misfit(census, data)
        assert result.chi_square == pytest.approx(expected, rel=1e-9)
        assert result.rank == 2
    alone = misfit(census, [first, second])
    assert alone.chi_square == pytest.approx(u**2 + v**2, rel=1e-9)
    for part, other in zip(misfit(census, [first, both]).parts, alone.parts, strict=True):
        assert (part.chi_square, part.error) == (other.chi_square, other.error)
    assert misfit(census, [both]).chi_square == pytest.approx(v**2, rel=1e-9)
    curve = misfit(census, [sizes()]).chi_square
    assert misfit(census, [first, sizes(), both]).chi_square == pytest.approx(curve + expected)


def test_the_standard_error_of_one_number_is_that_of_its_square():
    census = drawn_census(50, np.random.default_rng(2))
    means = census.counts.sum(axis=(1, 2)) / census.grains
    noise = float(np.var(means, ddof=1)) / 50
    result = misfit(census, [Datum.of_value("particles_left", 0.3, 0.02)])
    total = 0.02**2 + noise
    moves = (means - np.mean(means)) * (float(np.mean(means)) - 0.3) / total
    variance = float(np.var(2.0 * moves - moves**2 / 50, ddof=1)) / 50
    expected = math.sqrt(variance - 2.0 * (noise / total) ** 2)
    assert result.standard_error == pytest.approx(expected, rel=1e-9)


def test_the_dropped_share_does_not_matter():
    data = several()
    census = drawn_census(20, np.random.default_rng(3))
    result = misfit(census, data)
    predicted = predictions(census, data)
    noise = sampling_noise(predicted.left_out)
    covariance = noise.shrunk + np.diag([0.0] * 4 + [d.covariance[0, 0] for d in data[1:]])
    covariance[:4, :4] += data[0].covariance
    centring = np.eye(8)
    centring[:4, :4] -= 0.25
    covariance = centring @ covariance @ centring
    away = predicted.pooled - np.concatenate([d.values for d in data])
    for dropped in range(4):
        kept = np.arange(8) != dropped
        scale = np.sqrt(np.diag(covariance)[kept])
        scaled = covariance[np.ix_(kept, kept)] / np.outer(scale, scale)
        residuals = away[kept] / scale
        chi_square = residuals @ np.linalg.solve(scaled, residuals)
        assert result.chi_square == pytest.approx(chi_square, rel=1e-9)
    assert result.rank == 7


def test_the_order_of_samples_and_of_data_does_not_matter():
    rng = np.random.default_rng(4)
    census = drawn_census(12, rng)
    order = rng.permutation(12)
    names = ("counts", "masses", "temperatures", "largest")
    shuffled = dataclasses.replace(census, **{n: getattr(census, n)[order] for n in names})
    data = several()
    expected = misfit(census, data)
    for result in (misfit(shuffled, data), misfit(census, data[::-1])):
        assert result[:5] == pytest.approx(expected[:5], rel=1e-8)


def test_parts_sum_to_the_whole_and_the_wrong_datum_is_found():
    data = several()
    census = drawn_census(40, np.random.default_rng(5))
    data[3] = Datum.of_value("particles_left", 0.8, 0.05)
    result = misfit(census, data)
    assert sum(part.share for part in result.parts) == pytest.approx(1.0, rel=1e-9)
    p_values = [part.p_value for part in result.parts]
    assert int(np.argmin(p_values)) == 3
    assert p_values[3] < 1e-6
    assert result.p_value < 1e-4
    assert result.parts[0].name == "sieves"
    assert [part.rank for part in result.parts] == [3, 1, 1, 1, 1]


def test_the_same_predictions_at_the_same_samples_correlate():
    census = drawn_census(30, np.random.default_rng(6))
    datum = Datum.of_value("d43", D43, 5e-6)
    noise = sampling_noise(predictions(census, [datum, datum]).left_out)
    assert noise.raw[0, 1] == pytest.approx(noise.raw[0, 0], rel=1e-12)
    assert 0.0 < noise.intensity < 0.1
    assert noise.shrunk[0, 1] == pytest.approx((1.0 - noise.intensity) * noise.raw[0, 1])


@pytest.mark.parametrize("samples", [2, 3])
def test_so_few_samples_have_no_correlations(samples):
    noise = sampling_noise(np.random.default_rng(7).normal(size=(samples, 4)))
    assert noise.intensity == 1.0
    assert np.all(noise.shrunk == np.diag(np.diag(noise.raw)))


def test_one_sample_has_a_value_without_an_error():
    result = misfit(drawn_census(1, np.random.default_rng(8)), several())
    assert math.isfinite(result.value)
    assert result.value == pytest.approx(result.chi_square / result.rank)
    assert math.isnan(result.standard_error)
    assert math.isnan(result.p_value)
    assert all(math.isnan(part.p_value) for part in result.parts)


def emptied(census, samples):
    return dataclasses.replace(
        census,
        counts=np.zeros_like(census.counts[:samples]),
        masses=np.zeros_like(census.masses[:samples]),
        temperatures=np.full_like(census.temperatures[:samples], math.nan),
        largest=np.zeros_like(census.largest[:samples]),
    )


@pytest.mark.parametrize("samples", [0, 1, 2, 5])
def test_a_string_without_particles_has_an_infinite_misfit(samples):
    census = emptied(drawn_census(5, np.random.default_rng(9)), samples)
    result = misfit(census, several())
    assert result.value == math.inf
    assert math.isnan(result.standard_error)
    assert len(result.parts) == 5


def test_where_all_particles_are_in_one_sample_the_noise_is_not_known():
    census = drawn_census(2, np.random.default_rng(10))
    census.counts[1] = census.masses[1] = census.largest[1] = 0.0
    result = misfit(census, several())
    assert math.isfinite(result.value)
    assert math.isnan(result.standard_error)
    assert math.isnan(result.p_value)


def test_samples_without_noise_leave_the_measurement_alone():
    census = expected_census(1e-4, 0.3, samples=5)
    result = misfit(census, [Datum.of_value("d43", D43 + 1e-5, 5e-6)])
    assert result.value == pytest.approx(4.0, rel=1e-2)
    assert result.standard_error == pytest.approx(0.0, abs=1e-6)
    assert result.p_value == pytest.approx(chi2.sf(result.chi_square, 1), rel=1e-6)


def test_tail_probabilities_are_those_of_hotelling():
    p, n = 3, 20
    # A covariance that is all estimated: W S is the identity.
    variance = (p + p**2) / (n - 1)
    square = 9.0
    expected = f.sf(square * (n - p) / (p * (n - 1)), p, n - p)
    assert tail_probability(square, p, variance) == pytest.approx(expected, rel=1e-12)
    assert tail_probability(square, p, 0.0) == pytest.approx(chi2.sf(square, p), rel=1e-12)


@settings(deadline=None, max_examples=25)
@given(decade=st.floats(-9.0, 1.0), seed=st.integers(0, 1000))
def test_a_misfit_does_not_depend_on_the_unit_of_length(decade, seed):
    def scaled(unit):
        data = [
            Datum("sizes", MIDDLE, counted_covariance(MIDDLE, 400), "mass", None, unit * edges),
            Datum.of_value("d43", unit * D43 * 1e4, unit * 0.05),
            Datum.of_value("spread", 0.3, 0.02),
        ]
        return misfit(drawn_census(8, np.random.default_rng(seed), median=unit), data)

    edges = CLASSES * 1e4
    assert scaled(10.0**decade)[:5] == pytest.approx(scaled(1.0)[:5], rel=1e-5, abs=1e-9)


def numbers_off(deviations, samples):
    """Return three data that differ from the truth by some standard errors of measurement.

    The variance of the samples is a fifth of that of each measurement.
    """
    error = 2.0 / math.sqrt(samples)
    truth = (("d43", D43, 0.1 * D43), ("particles_left", 0.5, 0.05), ("temperature", 300.0, 10.0))
    return [
        Datum.of_value(quantity, value + error * scatter * deviation, error * scatter)
        for (quantity, value, scatter), deviation in zip(truth, deviations, strict=True)
    ]


def repeated(samples, data, draws, seed):
    rng = np.random.default_rng(seed)
    results = [misfit(drawn_census(samples, rng), data) for _ in range(draws)]
    values = np.array([result.value for result in results])
    return values, math.sqrt(np.mean([result.standard_error**2 for result in results])), results


@pytest.mark.parametrize("samples", SAMPLES)
def test_sampling_noise_does_not_bias_the_value(samples):
    draws = 300
    values, _, results = repeated(samples, numbers_off((0.0, 0.0, 0.0), samples), draws, 11)
    error = np.std(values) / math.sqrt(draws)
    assert abs(np.mean(values)) < 4.0 * error
    assert np.mean([result.chi_square / 3 for result in results]) > 8.0 * error


@pytest.mark.parametrize("samples", SAMPLES)
@pytest.mark.parametrize("deviations", [(1.0, 2.0, 0.0), (-2.0, 2.0, 1.0)])
def test_the_standard_error_is_the_scatter_of_values(samples, deviations):
    draws = 300
    values, stated, _ = repeated(samples, numbers_off(deviations, samples), draws, 12)
    # A standard deviation is known to 1/√(2·draws); the jackknife is of first order in 1/samples.
    tolerance = 4.0 / math.sqrt(2.0 * draws) + 1.0 / samples
    assert stated / np.std(values) == pytest.approx(1.0, abs=tolerance)


@pytest.mark.parametrize("samples", SAMPLES)
def test_p_values_are_uniform_for_the_truth(samples):
    rng, draws, p_values, parts = np.random.default_rng(13), 300, [], []
    shares, error = true_shares(), 1.0 / math.sqrt(samples)
    counted = 40 * samples
    # Of first order in 1/samples, as the jackknife: 3600 draws of 5 samples have a share of 0.089
    # below 0.05, and 0.051 of 20.
    bias = 0.25 / samples
    for _ in range(draws):
        data = [
            sizes(rng.multinomial(counted, shares) / counted, counted),
            Datum.of_value("d43", D43 * (1.0 + 0.06 * error * rng.normal()), 0.06 * D43 * error),
            Datum.of_value("temperature", 300.0 + 10.0 * error * rng.normal(), 10.0 * error),
        ]
        result = misfit(drawn_census(samples, rng), data)
        p_values.append(result.p_value)
        parts.append([part.p_value for part in result.parts])
    for values in (p_values, *np.transpose(parts)):
        for level in (0.05, 0.5):
            share = np.mean(np.asarray(values) < level)
            noise = math.sqrt(level * (1.0 - level) / draws)
            assert abs(share - level) < 4.0 * noise + bias


IMPACTS = np.array([[speed, 1e-3, 1e-3, math.nan] for speed in (0.5, 1.0, 2.0)])


def measured_impacts(values=(0.8, 0.7, 0.6), error=0.05):
    size = len(values)
    covariance = error**2 * np.eye(size)
    return Datum("restitution", np.array(values), covariance, impacts=IMPACTS[:size])


def with_law(census, predicted=(0.75, 0.75, 0.65)):
    law = np.array(predicted)
    return dataclasses.replace(census, coefficients=lambda impacts: law[: len(impacts)])


@pytest.mark.parametrize("samples", [1, 2, 7])
def test_impacts_alone_have_an_exact_misfit_however_few_samples_there_are(samples):
    census = with_law(drawn_census(samples, np.random.default_rng(1)))
    found = misfit(census, [measured_impacts()])
    assert found.chi_square == pytest.approx(3.0)
    assert found.value == pytest.approx(1.0)
    assert found.standard_error == pytest.approx(0.0, abs=1e-12)
    assert found.p_value == pytest.approx(chi2.sf(3.0, 3))
    assert found.parts[0].p_value == pytest.approx(chi2.sf(3.0, 3))


def test_impacts_add_their_chi_square_to_that_of_other_data():
    census = with_law(drawn_census(6, np.random.default_rng(2)))
    others = [Datum.of_value(name, 1e-4, 2e-5) for name in ("d43", "d32")]
    alone = misfit(census, others)
    both = misfit(census, [others[0], measured_impacts(), others[1]])
    assert both.rank == alone.rank + 3
    assert both.chi_square == pytest.approx(alone.chi_square + 3.0)
    assert both.value * both.rank == pytest.approx(alone.value * alone.rank + 3.0)
    assert both.standard_error * both.rank == pytest.approx(alone.standard_error * alone.rank)
