"""Posteriors of data that are linear in two variables, and of a small campaign's data."""

import dataclasses

import numpy as np
import pytest
from toy_posteriors import correlated, linear_emulator, measurements

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference import data_calibration
from agglom_mpi.inference.data_emulator import log_densities
from agglom_mpi.inference.data_posterior import MeasuredMean, data_posterior, posterior_of
from agglom_mpi.inference.posterior import PosteriorError
from agglom_mpi.inference.posterior_sampling import BoxPart
from agglom_mpi.inference.searched_box import EmulatedStrings
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.measurements.misfit import UNLIKELY
from agglom_mpi.search.criteria import Band
from agglom_mpi.storage.reader import read_campaign

SLOPES = np.array([[1.0, 0.0], [1.0, 1.0], [0.5, -0.5]])
TRUTH = np.array([0.45, 0.6])
ERRORS = np.array([0.05, 0.05, 0.08])


def measured_at(place, errors=ERRORS, slopes=SLOPES):
    """Return data without any error, though errors of that size are stated."""
    return measurements(1.0 + slopes @ place, errors)


@pytest.fixture(scope="module")
def emulated(tmp_path_factory):
    return linear_emulator(tmp_path_factory.mktemp("toy"), SLOPES, measured_at(TRUTH))


@pytest.fixture(scope="module")
def posterior(emulated):
    return single_threaded(posterior_of)(emulated)


def moments(posterior):
    """Return mean and covariance of the place in the unit square."""
    places = posterior.of.box.space.to_unit(posterior.strings)
    return posterior.weights @ places, np.cov(places.T, aweights=posterior.weights)


def test_a_linear_problem_has_the_posterior_of_generalised_least_squares(posterior):
    """The emulator knows each value to some 0.01, which widens the posterior by a few percent."""
    precision = SLOPES.T @ np.diag(ERRORS**-2.0) @ SLOPES
    expected = np.linalg.inv(precision)
    mean, covariance = moments(posterior)
    deviation = np.sqrt(np.diag(expected))
    size = posterior.effective_size
    assert np.all(np.abs(mean - TRUTH) < 4.0 * deviation / np.sqrt(size) + 0.25 * deviation)
    ratio = np.sqrt(np.linalg.eigvals(covariance @ precision).real)
    assert np.all(np.abs(ratio - 1.0) < 4.0 / np.sqrt(2.0 * size) + 0.08)


CORRELATIONS = np.array([[1.0, 0.8, 0.0], [0.8, 1.0, -0.3], [0.0, -0.3, 1.0]])
COVARIANCE = CORRELATIONS * np.outer(ERRORS, ERRORS)


@pytest.fixture(scope="module")
def correlating(tmp_path_factory):
    data = correlated(measured_at(TRUTH), CORRELATIONS)
    folder = tmp_path_factory.mktemp("toy")
    return single_threaded(posterior_of)(linear_emulator(folder, SLOPES, data))


def test_correlated_errors_have_the_posterior_of_generalised_least_squares(correlating, posterior):
    precision = SLOPES.T @ np.linalg.inv(COVARIANCE) @ SLOPES
    mean, covariance = moments(correlating)
    deviation, size = np.sqrt(np.diag(np.linalg.inv(precision))), correlating.effective_size
    assert np.all(np.abs(mean - TRUTH) < 4.0 * deviation / np.sqrt(size) + 0.25 * deviation)
    ratio = np.sqrt(np.linalg.eigvals(covariance @ precision).real)
    assert np.all(np.abs(ratio - 1.0) < 4.0 / np.sqrt(2.0 * size) + 0.1)
    assert correlating.calibration.passed
    assert correlating.volume < 0.9 * posterior.volume


def test_measurements_that_are_made_up_have_the_stated_covariance(tmp_path):
    """Both those of the file for ArviZ and those of the calibration; the emulator hardly errs."""
    data = correlated(measured_at(TRUTH), CORRELATIONS)
    of = linear_emulator(tmp_path, SLOPES, data, noise=1e-4)
    count, random = 4000, np.random.default_rng(1)
    strings = np.repeat(of.box.even_strings(1), count, axis=0)
    draws = np.hstack(of.measurements(strings, random, given=False))
    kept = of.frame.basis @ of.components
    made_up, _ = single_threaded(data_calibration._made_up)(of, strings[:400], random)
    for found, expected in ((draws, COVARIANCE), (made_up, kept.T @ COVARIANCE @ kept)):
        variances = np.diag(expected)
        error = np.sqrt((np.outer(variances, variances) + expected**2) / len(found))
        assert np.all(np.abs(np.cov(found.T) - expected) < 4.0 * error + 1e-3 * variances.max())


def test_the_region_of_a_normal_posterior_is_an_ellipse(posterior):
    """90 % of a normal distribution of two variables lie within χ² of 4.61."""
    _, covariance = moments(posterior)
    area = np.pi * 4.605 * np.sqrt(np.linalg.det(covariance))
    assert posterior.volume == pytest.approx(area, rel=0.1)
    for i, width in enumerate(posterior.contraction.values()):
        assert width == pytest.approx(2 * 1.645 * np.sqrt(covariance[i, i]) / 0.9, rel=0.1)


def test_one_number_has_the_density_of_a_measured_mean(tmp_path):
    [datum] = data = measurements([1.4], [0.05])
    emulated = linear_emulator(tmp_path, SLOPES[:1], data)

    class OneNumber:
        box, coordinates = emulated.box, emulated.coordinates
        criterion = Band("mean", 1.3, 1.5, "a mean")

        @property
        def prior(self):
            return None, self.at(self.box.even_strings(64))

        def at(self, strings):
            found = emulated.at(strings)
            scale = emulated.emulator.mixing[0, 0] * 0.05 * np.sign(emulated.components[0, 0])
            start = float(emulated.values_of(np.zeros((1, 1)), np.zeros((1, 0)))[0, 0])
            means = start + scale * found.means
            return EmulatedStrings(means, np.abs(scale) * found.deviations, found.failing)

    alone = MeasuredMean(OneNumber(), float(datum.values[0]), 0.05)
    strings = emulated.box.even_strings(512)
    away = alone.log_density(strings) - emulated.log_density(strings)
    assert away == pytest.approx(np.full(len(strings), away[0]), abs=1e-6)


def test_the_order_of_data_does_not_matter(tmp_path, posterior):
    order = [2, 0, 1]
    data = [measured_at(TRUTH)[i] for i in order]
    turned = single_threaded(posterior_of)(linear_emulator(tmp_path, SLOPES[order], data))
    mean, covariance = moments(posterior)
    other, _ = moments(turned)
    # The noise of the samples is another one.
    assert np.all(np.abs(mean - other) < 0.5 * np.sqrt(np.diag(covariance)))
    assert turned.volume == pytest.approx(posterior.volume, rel=0.2)


def test_all_data_together_say_more_than_each_alone(tmp_path, posterior):
    for i in range(len(SLOPES)):
        folder = tmp_path / str(i)
        folder.mkdir()
        data = [measured_at(TRUTH)[i]]
        alone = single_threaded(posterior_of)(linear_emulator(folder, SLOPES[[i]], data))
        assert alone.volume > posterior.volume
        for name, width in posterior.contraction.items():
            assert alone.contraction[name] > width


def test_strings_like_those_that_failed_have_no_weight(tmp_path):
    failing = lambda places: places[:, 1] > 0.6  # noqa: E731
    data = measured_at(TRUTH, errors=np.full(3, 0.2))
    whole = moments(single_threaded(posterior_of)(linear_emulator(tmp_path, SLOPES, data)))
    part = single_threaded(posterior_of)(linear_emulator(tmp_path, SLOPES, data, failing=failing))
    places = part.of.box.space.to_unit(part.strings)
    assert part.weights @ (places[:, 1] > 0.75) < 0.02
    assert moments(part)[0][1] < whole[0][1]


def test_what_the_data_cannot_tell_apart_is_not_emulated(tmp_path):
    slopes = np.array([[1.0, 0.0], [0.0, 1e-4]])
    data = measurements([1.4, 1.0], [0.05, 0.05])
    emulated = linear_emulator(tmp_path, slopes, data, noise=1e-3)
    assert emulated.components.shape == (2, 1)
    assert emulated.left_out_variance.max() < 0.01


def test_values_of_components_are_what_they_were_made_of(emulated):
    values = np.array([[1.2, 1.5, 1.1], [1.4, 2.0, 0.9]])
    assert emulated.left_out.shape == (3, 1)  # two variables, so the third number follows
    framed = values @ emulated.frame.basis - emulated.centre
    again = emulated.values_of(emulated.numbers_of(values), framed @ emulated.left_out)
    assert again == pytest.approx(values)


def test_predictions_of_shares_have_the_sum_of_shares(tmp_path):
    edges = np.array([0.0, 1.0, 2.0, np.inf])
    shares = np.array([0.5, 0.3, 0.2])
    covariance = (np.diag(shares) - np.outer(shares, shares)) / 200
    datum = Datum("sizes", shares, covariance, edges=edges, name="sizes")
    slopes = np.array([[0.5, 0.0], [-0.3, 0.2], [-0.2, -0.2]])
    emulated = linear_emulator(tmp_path, slopes, [datum], noise=0.0)
    emulated.measured = emulated.numbers_of(1.0 + slopes @ TRUTH)
    [predicted] = single_threaded(posterior_of)(emulated).predictions
    # The toy's values are 1 more than shares each.
    assert predicted.draws.sum(axis=1) == pytest.approx(np.full(len(predicted.draws), 3.0))


def test_predictions_lie_near_data_that_agree(posterior):
    for predicted in posterior.predictions:
        error = np.sqrt(predicted.datum.covariance[0, 0])
        assert abs(predicted.median[0] - predicted.datum.values[0]) < error
        low, high = predicted.quantiles((0.05, 0.95))[:, 0]
        assert 0.0 < high - low < 2.0 * 1.645 * error * 1.2
        assert not predicted.disagrees
    assert posterior.p_value > UNLIKELY
    assert not posterior.warning


def test_a_datum_that_no_string_gives_is_named(tmp_path):
    slopes = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])
    data = measurements([1.4, 1.5, 1.9], [0.02, 0.05, 0.2])
    found = single_threaded(posterior_of)(linear_emulator(tmp_path, slopes, data))
    assert [each.disagrees for each in found.predictions] == [False, False, True]
    assert found.as_dict()["data"][2]["p_value"] < UNLIKELY


def test_data_that_no_string_fits_are_told_wherever_the_posterior_is_shown(tmp_path):
    slopes = np.array([[1.0, 0.0], [1.0, 0.0]])
    data = measurements([1.2, 1.8], [0.05, 0.05])
    found = single_threaded(posterior_of)(linear_emulator(tmp_path, slopes, data))
    assert found.p_value < 1e-3
    assert "fits" in found.warning
    assert found.warning in repr(found)
    assert found.as_dict()["warning"] == found.warning


@pytest.mark.parametrize(("away", "p"), [(0.20, (1e-3, UNLIKELY)), (0.6, (0.0, 1e-3))])
def test_data_that_disagree_are_warned_of_at_every_level(tmp_path, away, p):
    """Two measurements of one number that differ by 2.8 and by 8.5 of their errors."""
    slopes = np.array([[1.0, 0.0], [1.0, 0.0]])
    data = measurements([1.5 - away / 2, 1.5 + away / 2], [0.05, 0.05])
    found = single_threaded(posterior_of)(linear_emulator(tmp_path, slopes, data))
    assert p[0] < found.p_value < p[1]
    assert found.misfit_text in found.warning
    # The verdict on made-up data says nothing of these.
    assert "the posterior" not in found.calibration.text or not found.calibration.passed


def test_predictions_outside_of_what_strings_gave_are_marked(tmp_path):
    """Strings reach 1 to 2; a quantity cannot exceed what the classes of a census can hold."""
    data = measurements([2.6, 1.5], [0.02, 0.05])
    emulated = linear_emulator(tmp_path, np.eye(2), data, noise=0.3)
    emulated.lengths = 0.5, 2.2
    found = single_threaded(posterior_of)(emulated)
    first, second = found.predictions
    assert (first.outside, second.outside) == (True, False)
    assert first.draws.max() <= 2.2
    assert found.as_dict()["data"][0]["outside"] is True
    assert first.verdict
    assert not second.outside


def test_an_error_above_all_that_strings_differ_by_is_marked(tmp_path):
    """Strings reach 1 to 2 in both, with noise of their means."""
    data = measurements([1.5, 1.5], [0.05, 5.0])
    found = single_threaded(posterior_of)(linear_emulator(tmp_path, np.eye(2), data))
    sharp, blunt = found.predictions
    assert (sharp.blind, blunt.blind) == (False, True)
    assert blunt.verdict
    assert not sharp.verdict
    assert found.as_dict()["data"][1]["blind"] is True


def test_no_measurement_is_proposed_where_no_string_fits(tmp_path):
    slopes = np.array([[1.0, 0.0], [1.0, 0.0]])
    data = measurements([1.2, 1.8], [0.05, 0.05])
    found = single_threaded(posterior_of)(linear_emulator(tmp_path, slopes, data))
    with pytest.raises(PosteriorError, match="p ="):
        dataclasses.replace(found, file=object()).next_measurements()


def test_ends_of_the_box_that_a_posterior_touches_are_named(tmp_path):
    """The first variable piles up at its lower end; of the second nothing is measured."""
    data = measurements([1.0], [0.1])
    emulated = linear_emulator(tmp_path, np.array([[1.0, 0.0]]), data)
    found = single_threaded(posterior_of)(emulated)
    first, second = found.of.box.own
    assert found.touches == {first.name: ("lower",), second.name: ()}
    assert f"{first.lower:.4g} of {first.name}" in found.warning
    assert second.name not in found.warning
    assert found.as_dict()["touches"] == {first.name: ["lower"], second.name: []}
    assert found.as_dict()["warning"] == found.warning


def test_an_arviz_file_has_each_datum_with_its_predictions(posterior):
    pytest.importorskip("xarray")
    groups = posterior.groups(draws=500, seed=2)
    assert groups["posterior"].sizes == {"chain": 4, "draw": 125}
    for i, (value, error) in enumerate(zip(1.0 + SLOPES @ TRUTH, ERRORS, strict=True)):
        name = f"datum_{i}_mean_diameter"
        assert float(groups["observed_data"][name][0]) == pytest.approx(value)
        assert float(groups["constant_data"][f"{name}_standard_error"][0]) == pytest.approx(error)
        drawn = groups["posterior_predictive"][name].to_numpy()
        # A further measurement has its own error, and that of what is known.
        assert drawn.shape == (4, 125, 1)
        assert error * 0.9 < drawn.std() < error * np.sqrt(2.0) * 1.2
        assert groups["prior_predictive"][name].to_numpy().std() > drawn.std()


def test_given_precise_data_the_error_of_the_emulator_is_smaller(posterior, tmp_path):
    """V (V + 1)⁻¹ instead of V along directions in which the measurement's covariance is 1."""
    data, count = measurements(1.0 + SLOPES @ TRUTH, ERRORS / 30.0), 20000
    of = linear_emulator(tmp_path, SLOPES, data)
    known = dataclasses.replace(posterior, of=of)
    strings = np.repeat(posterior.strings[:1], count, axis=0)
    own = of.covariances(of.at(strings[:1]).deviations)[0]
    assert np.diag(own).min() > 0.5
    error = 4.0 * np.sqrt(2.0 / count) * np.diag(own).max()
    expected = {False: own, True: own @ np.linalg.inv(own + np.eye(len(own)))}
    for given, covariance in expected.items():
        random = np.random.default_rng(7)
        drawn, _ = single_threaded(known.of.drawn_components)(strings, random, given=given)
        assert np.cov(drawn.T) == pytest.approx(covariance, rel=0.0, abs=error)


def test_points_of_a_part_of_the_box_are_even(emulated):
    """As many as their volume says lie in a small square inside."""
    line = np.linspace(0.3, 0.7, 50)
    part = BoxPart.around(np.column_stack((line, line + 0.02 * np.cos(40 * line))))
    count = 1 << 12
    places = emulated.box.space.to_unit(part.even_strings(emulated.box, count))
    expected = count / part.volume * 0.02**2
    inside = np.all(np.abs(places - 0.5) < 0.01, axis=1).sum()
    assert abs(inside - expected) < 4.0 * np.sqrt(expected)


def test_a_chain_finds_the_same_posterior(emulated, posterior, monkeypatch):
    pytest.importorskip("emcee")
    monkeypatch.setattr("agglom_mpi.inference.posterior_sampling.MIN_SIZE", 1e9)
    monkeypatch.setattr("agglom_mpi.inference.posterior_sampling.CHAIN_STEPS", 300)
    chain = single_threaded(posterior_of)(emulated)
    assert chain.method == "chain"
    mean, covariance = moments(posterior)
    size = min(chain.effective_size, posterior.effective_size)
    away = np.abs(moments(chain)[0] - mean) / np.sqrt(np.diag(covariance))
    assert np.all(away < 4.0 * np.sqrt(2.0 / size))
    assert chain.volume == pytest.approx(posterior.volume, rel=0.25)


def test_densities_of_several_data_are_those_of_each(emulated):
    known = emulated.at(emulated.box.even_strings(64))
    factors = emulated.factors(known.deviations)
    away = np.random.default_rng(4).normal(size=(3, *known.means.shape))
    together = log_densities(away, factors, known.failing)
    for i in range(3):
        alone = log_densities(away[i : i + 1], factors, known.failing)
        assert together[i] == pytest.approx(alone[0])


def test_a_campaign_without_data_is_told_what_to_use(three):
    with pytest.raises(PosteriorError, match=r"three\.h5: .*data.*feasible_set"):
        three.posterior()


def test_a_small_campaign_has_too_few_strings(measured_file):
    with pytest.raises(PosteriorError, match=r"measured\.h5: .*\d+ different .*at least 50"):
        data_posterior(read_campaign(measured_file))
