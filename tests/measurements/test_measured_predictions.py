import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measured_samples import bins, census_of, drawn_census, expected_census
from scipy.special import ndtr, ndtri

from agglom_mpi.measurements.datum import Datum, predictions
from agglom_mpi.measurements.quantities import PARTICLE_WEIGHTS, QUANTITIES

POWERS = {"number": 0, "area": 2, "mass": 3}
CLASSES = np.array([0.0, 0.7e-4, 1e-4, 1.3e-4, np.inf])


def number(quantity, weight="number", time=None):
    return Datum.of_value(quantity, 1.0, 1.0, weight, time)


def classes(edges, weight="mass"):
    size = len(edges) - 1
    return Datum("sizes", np.full(size, 1.0 / size), np.eye(size), weight, edges=edges)


QUANTILES = {name: kind.share for name, kind in QUANTITIES.items() if kind.share is not None}
ALL = [
    *(
        number(name, weight)
        for name, kind in QUANTITIES.items()
        if not kind.has_file
        for weight in PARTICLE_WEIGHTS
    ),
    *(classes(CLASSES, weight) for weight in PARTICLE_WEIGHTS),
]
SMOOTH = [datum for datum in ALL if datum.quantity not in QUANTILES]


def predicted(census, *data):
    return predictions(census, data).pooled


@settings(deadline=None, max_examples=40)
@given(decade=st.floats(-9.0, 1.0), log_spread=st.floats(0.1, 0.8))
def test_lognormal_sizes_have_the_diameters_of_hatch_and_choate(decade, log_spread):
    median, square = 10.0**decade, log_spread**2
    census = expected_census(median, log_spread)
    # The mean-mass diameter and the straight line in a bin are exact to its width squared.
    tolerance = 0.02**2 * (1.0 + 1.0 / log_spread)
    for weight, power in POWERS.items():
        for name, share in QUANTILES.items():
            expected = median * math.exp(power * square + log_spread * ndtri(share))
            assert predicted(census, number(name, weight)) == pytest.approx(expected, rel=tolerance)
        mean = median * math.exp((power + 0.5) * square)
        means = predicted(census, number("mean_diameter", weight), number("mean_radius", weight))
        assert means == pytest.approx([mean, 0.5 * mean], rel=tolerance)
    sauter, brouckere = (median * math.exp(power * square) for power in (2.5, 3.5))
    assert predicted(census, number("d32"), number("d43")) == pytest.approx(
        [sauter, brouckere], rel=tolerance
    )
    spread = math.sqrt(math.expm1(square))
    assert predicted(census, number("spread")) == pytest.approx(spread, rel=1e-2)


@pytest.mark.parametrize("weight", PARTICLE_WEIGHTS)
def test_shares_of_classes_are_those_of_the_lognormal(weight):
    census = expected_census(1e-4, 0.3)
    scaled = np.log(CLASSES[1:-1] / 1e-4) / 0.3 - 0.3 * POWERS[weight]
    expected = np.diff([0.0, *ndtr(scaled), 1.0])
    assert np.abs(predicted(census, classes(CLASSES, weight)) - expected).max() < 1e-3


def test_a_bin_is_shared_between_classes_by_its_logarithm():
    edges = bins(1e-4, 1e-4)
    census = census_of([[np.full(8, 1e-4)]], 1, edges, grains=8)
    cut = edges[0] * (edges[1] / edges[0]) ** 0.25
    assert predicted(census, classes(np.array([0.0, cut, 1.0]))) == pytest.approx([0.25, 0.75])


def test_what_lies_beyond_all_classes_is_in_the_outermost():
    sizes = np.array([1e-5, 1e-5, 1e-4, 1e-3])
    census = census_of([[sizes]], 1, bins(1e-5, 1e-3), grains=4)
    edges = np.array([5e-5, 8e-5, 2e-4, 3e-4])
    assert predicted(census, classes(edges, "number")) == pytest.approx([0.5, 0.25, 0.25])


def test_numbers_of_unequal_samples_are_those_of_all_particles_together():
    sizes = [np.full(3, 1e-4), np.full(1, 2e-4)]
    census = census_of(
        [[sizes[0]], [sizes[1]]],
        1,
        bins(1e-4, 2e-4),
        grains=10,
        temperatures=np.array([[300.0], [410.0]]),
    )
    data = [number(name) for name in ("mean_diameter", "particles_left", "largest_mass_fraction")]
    assert predicted(census, *data) == pytest.approx([1.25e-4, 4 / 20, 9 / 11])
    assert predicted(census, number("temperature")) == pytest.approx(300.0 + 110.0 * 8 / 11)


def test_equal_grains_have_exact_mean_diameters_and_no_spread():
    census = census_of([[np.full(5, 1e-4)]], 1, bins(1e-4, 2e-4), grains=5)
    data = [number("mean_diameter", weight) for weight in PARTICLE_WEIGHTS] + [number("d32")]
    assert predicted(census, *data) == pytest.approx(np.full(4, 1e-4), rel=1e-12)
    assert predicted(census, number("spread"))[0] < 1e-7
    assert predicted(census, number("d50"))[0] == pytest.approx(1e-4, rel=1e-12)


def without(census, sample):
    kept = np.arange(census.samples) != sample
    arrays = ("counts", "masses", "temperatures", "largest")
    return dataclasses.replace(census, **{name: getattr(census, name)[kept] for name in arrays})


def test_left_out_predictions_are_those_of_the_other_samples():
    census = drawn_census(6, np.random.default_rng(1))
    left_out = predictions(census, SMOOTH).left_out
    for sample in range(6):
        expected = predicted(without(census, sample), *SMOOTH)
        assert np.allclose(left_out[sample], expected, rtol=1e-9, atol=1e-12)


def test_left_out_quantiles_move_as_those_of_the_other_samples():
    census = drawn_census(20, np.random.default_rng(1), grains=2000)
    data = [number("d50", weight) for weight in PARTICLE_WEIGHTS]
    both = predictions(census, data)
    moves = both.left_out - both.pooled
    direct = np.array([predicted(without(census, s), *data) for s in range(20)]) - both.pooled
    for column in range(3):
        assert np.corrcoef(moves[:, column], direct[:, column])[0, 1] > 0.95
        ratio = np.std(moves[:, column]) / np.std(direct[:, column])
        assert 0.8 < ratio < 1.25


def test_the_jackknife_has_the_scatter_of_the_predictions():
    rng, draws, samples = np.random.default_rng(3), 250, 20
    pooled, variances = [], []
    for _ in range(draws):
        result = predictions(drawn_census(samples, rng), ALL)
        pooled.append(result.pooled)
        variances.append((samples - 1) ** 2 / samples * np.var(result.left_out, axis=0, ddof=1))
    ratios = np.mean(variances, axis=0) / np.var(pooled, axis=0, ddof=1)
    # The jackknife is conservative by a few samples' worth (Efron and Stein 1981).
    error = math.sqrt(2.0 / draws)
    assert np.all(ratios > 1.0 - 4.0 * error)
    assert np.all(ratios < 1.25 + 4.0 * error)


def test_each_datum_is_compared_at_its_own_time():
    rng = np.random.default_rng(4)
    census = drawn_census(3, rng, times=2)
    data = [number("d43"), number("d43", time=1e-3), number("temperature", time=1e-3)]
    later, early, temperature = predicted(census, *data)
    masses = np.sum(census.masses, axis=2)
    expected = np.sum(census.masses * census.diameters, axis=(0, 2)) / np.sum(masses, axis=0)
    assert [early, later] == pytest.approx(expected, rel=1e-12)
    heat = np.sum(masses * census.temperatures, axis=0) / np.sum(masses, axis=0)
    assert temperature == pytest.approx(heat[0])


def test_a_census_at_other_times_is_refused():
    census = drawn_census(3, np.random.default_rng(4), times=2)
    with pytest.raises(ValueError, match="times"):
        predictions(census, ALL)


@settings(deadline=None, max_examples=30)
@given(decade=st.floats(-9.0, 2.0), seed=st.integers(0, 1000))
def test_predictions_scale_with_the_sizes(decade, seed):
    median = 10.0**decade
    small = drawn_census(3, np.random.default_rng(seed), median=1.0)
    large = drawn_census(3, np.random.default_rng(seed), median=median)
    lengths = [number(name, "mass") for name in ("d10", "d50", "d90", "d43", "mean_radius")]
    ratios = [number("spread"), number("largest_mass_fraction"), number("particles_left")]
    assert predicted(large, *lengths) == pytest.approx(
        median * predicted(small, *lengths), rel=1e-6
    )
    assert predicted(large, *ratios) == pytest.approx(predicted(small, *ratios), rel=1e-6)


def test_one_sample_predicts_and_has_none_without_it():
    result = predictions(drawn_census(1, np.random.default_rng(5)), ALL)
    assert np.all(np.isfinite(result.pooled))
    assert np.all(np.isnan(result.left_out))
    assert result.left_out.shape == (1, len(result.pooled))
