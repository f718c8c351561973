import dataclasses

import numpy as np
import pytest
from toy_posteriors import linear_emulator, measurements

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference import data_calibration
from agglom_mpi.inference.calibration import Region
from agglom_mpi.inference.data_calibration import DataCalibration, calibrate_posterior
from agglom_mpi.inference.data_posterior import posterior_of

NAMES = ("first", "second")
EVEN = np.column_stack([(np.arange(200) + 0.5) / 200] * 2)
SLOPES = np.array([[1.0, 0.2], [0.3, 1.0]])


@pytest.fixture(scope="module")
def posterior(tmp_path_factory):
    data = measurements(1.0 + SLOPES @ [0.5, 0.4], [0.05, 0.05])
    emulated = linear_emulator(tmp_path_factory.mktemp("toy"), SLOPES, data, noise=0.1)
    return single_threaded(posterior_of)(emulated)


def calibration(ranks=EVEN, held_out=0.9, size=300.0):
    return DataCalibration(NAMES, ranks, size, Region("near", 50, held_out, 1.0))


def test_ranges_of_a_toy_hold_the_truth_as_often_as_they_claim(posterior):
    found = posterior.calibration
    for covered in found.coverage.values():
        assert abs(covered - 0.9) < 4.0 * found.standard_error
    assert min(found.uniformity.values()) > 1e-5
    assert found.effective_size > 50.0
    assert found.passed


def test_too_small_a_covariance_is_noticed(posterior, monkeypatch):
    """Ranges that are a third as wide as they should be hold two thirds of the truths at most."""
    whole = type(posterior.of).factors
    monkeypatch.setattr(type(posterior.of), "factors", lambda *of: whole(*of) / 3.0)
    found = single_threaded(calibrate_posterior)(posterior.of, posterior)
    assert not found.passed
    shown = dataclasses.replace(posterior, calibration=found)
    assert found.text in shown.warning
    assert found.text in repr(shown)
    assert shown.as_dict()["calibration"]["calibrated"] is False
    assert shown.groups(draws=10)["posterior"].attrs["warning"] == shown.warning


def test_noise_of_single_samples_is_drawn_as_well(posterior):
    """Data sets differ from each other by the noise of all strings."""
    of = posterior.of
    random = np.random.default_rng(3)
    noise = data_calibration._noise(of, 400, random)
    mixed = np.linalg.solve(of.emulator.mixing, of.samples.T).T
    _, which = np.unique(of.points, axis=0, return_inverse=True)
    for i in (0, 17):
        mine = mixed[which.ravel() == i]
        expected = mine.std(axis=0, ddof=1) / np.sqrt(len(mine))
        assert noise[:, i].std(axis=0) == pytest.approx(expected, rel=4.0 / np.sqrt(800))


def test_even_ranks_are_calibrated():
    found = calibration()
    assert found.passed
    assert found.coverage == {"first": 0.9, "second": 0.9}
    assert "first" not in found.text
    assert "± 2.1 %" in found.text


def test_truths_outside_of_the_ranges_are_told_with_their_variable():
    ranks = EVEN.copy()
    ranks[:, 1] = 0.5 + np.sign(EVEN[:, 1] - 0.5) * np.sqrt(np.abs(EVEN[:, 1] - 0.5) / 2.0)
    found = calibration(ranks)
    assert found.worst[0] == "second"
    assert not found.passed
    assert "second" in found.text
    assert "first" not in found.text


def test_ranks_on_one_side_are_not_uniform():
    found = calibration(np.column_stack((EVEN[:, 0], 0.06 + 0.88 * EVEN[:, 1] ** 2)))
    assert found.coverage["second"] >= 0.9
    assert found.uniformity["second"] < 1e-5
    wide = calibration(0.2 + 0.6 * EVEN)
    assert wide.passed
    assert "more" in wide.text


def test_ranks_among_few_strings_are_compared_as_two_samples():
    """Ranks off by 0.12 are improbable among thousands of strings, and usual among 50."""
    ranks = np.clip(EVEN - 0.12, 0.0, 1.0)
    of_many = calibration(ranks, size=1e6).uniformity["first"]
    of_few = calibration(ranks, size=50.0).uniformity["first"]
    assert of_many < 0.01 < 0.3 < of_few


def test_truths_and_strings_that_they_are_compared_with_have_one_density(posterior):
    """Means of both are equal within their errors, and none stands on both sides.

    Without a weight for the share that is drawn, truths would lie a tenth wider.
    """
    random = np.random.default_rng(8)
    drawn, of = posterior, posterior.of
    every = drawn.weights ** (1.0 / data_calibration.TEMPERATURE)
    places = of.box.space.to_unit(drawn.strings)
    centre = every @ places / every.sum()
    spread = every @ (places - centre) ** 2 / every.sum()
    truths, others, weights = data_calibration._truths_and_others(of, drawn, 20_000, random)
    for strings, mass in ((truths, np.ones(len(truths))), (others, weights)):
        mine = (of.box.space.to_unit(strings) - centre) ** 2
        ratio = mass @ mine / mass.sum() / spread
        assert ratio == pytest.approx(np.ones(2), abs=0.06)
    assert not set(map(bytes, truths)) & set(map(bytes, others))


def test_an_emulator_that_errs_near_the_data_is_told():
    found = calibration(held_out=0.6)
    assert not found.passed
    assert "60.0 %" in found.text
    assert found.as_dict()["held_out_coverage"] == 0.6
