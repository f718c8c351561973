"""Posteriors of impacts: evaluated at each string, alone and beside data that are emulated."""

import dataclasses
import math

import numpy as np
import pytest
from measured_runs import write_measured
from toy_posteriors import NOISE, SAMPLES, STRINGS, measurements

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.contributions import predict_data
from agglom_mpi.inference.data_emulator import EmulatedData
from agglom_mpi.inference.data_posterior import posterior_of
from agglom_mpi.inference.evidence import evidence_of
from agglom_mpi.inference.expected_volume import expected_volume
from agglom_mpi.inference.next_measurement import dense_points, measurables
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.stored_samples import StoredSamples, StringValues
from agglom_mpi.measurements.datum import Datum

SPEEDS = np.geomspace(0.1, 3.0, 3)
ERROR = 0.02
IMPACTS = """\
scene: {particles: 2, grain_radius: 1 mm, velocities: uniform_x, heating: none, end_time: 1 us,
  restitution: {law: wet, film_thickness: 10 um, roughness: 1 um, dry: {law: constant}}}
variables:
  relative_speed: 1
  volume_fraction: 0.01
  density: 2500
  restitution.dry.value: [0.5, 1]
  restitution.viscosity: [1 mPa*s, 100 mPa*s, log]
data: [{quantity: restitution, file: i.csv, error: 0.02}]
objective: misfit
ensemble: {rule: fixed, samples: 1}
stopping: {generations: 1}
"""


def box_of_impacts(folder):
    rows = "".join(f"{speed!r};1;0.5\n" for speed in SPEEDS.tolist())
    (folder / "i.csv").write_text(f"speed (m/s);radius (mm);coefficient\n{rows}")
    path = folder / "c.yaml"
    path.write_text(IMPACTS)
    return SearchedBox(load_campaign(path))


def coefficients(box, string):
    return box.campaign.impact_tests_at(string).coefficients(box.campaign.data[0].impacts)


def emulator_of(box, values):
    """Return the emulator of impacts with measured coefficients, which has seen no sample."""
    data = (dataclasses.replace(box.campaign.data[0], values=np.asarray(values)),)
    none = np.empty((0, len(box.campaign.parameters())))
    stored = StoredSamples(none, np.empty(0), none, np.empty(0, bool))
    return EmulatedData(box, data, StringValues(none, np.empty((0, len(values)))), stored)


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    return box_of_impacts(tmp_path_factory.mktemp("impacts"))


def truth_of(box, place):
    return box.space.from_unit(np.asarray(place)[None])[0]


@pytest.fixture(scope="module")
def posterior(box):
    noise = ERROR * np.random.default_rng(1).normal(size=len(SPEEDS))
    values = coefficients(box, truth_of(box, (0.6, 0.4))) + noise
    return single_threaded(posterior_of)(emulator_of(box, values))


def test_impacts_need_no_samples_and_have_the_density_of_their_errors(box, posterior):
    of = posterior.of
    strings = box.even_strings(64)
    expected = [
        -0.5 * np.sum(((of.data[0].values - coefficients(box, s)) / ERROR) ** 2) for s in strings
    ]
    assert of.log_density(strings) == pytest.approx(np.array(expected), rel=1e-9)
    assert of.emulator.processes == []


def test_the_posterior_is_that_of_a_dense_grid(box, posterior):
    """Its quantiles differ by the Monte-Carlo error of both alone."""
    strings = box.even_strings(1 << 12)
    logarithms = posterior.of.log_density(strings)
    weights = np.exp(logarithms - logarithms.max())
    weights /= weights.sum()
    grid, mine = box.space.to_unit(strings), box.space.to_unit(posterior.strings)
    sizes = 1.0 / np.sum(weights**2), posterior.effective_size
    for i in range(2):
        mean, other = weights @ grid[:, i], posterior.weights @ mine[:, i]
        deviation = math.sqrt(weights @ (grid[:, i] - mean) ** 2)
        assert abs(mean - other) < 4.0 * deviation * math.sqrt(sum(1.0 / s for s in sizes))
        assert abs(other - (0.6, 0.4)[i]) < 4.0 * deviation


def test_the_evidence_of_impacts_is_that_of_a_dense_grid(box, posterior):
    found = single_threaded(evidence_of)(posterior.of, posterior)
    logarithms = posterior.of.log_density(box.even_strings(1 << 14))
    density = np.exp(logarithms - 0.5 * len(SPEEDS) * math.log(2.0 * math.pi))
    assert abs(found.logarithm - math.log(density.mean())) < 4.0 * found.error + 0.01


def test_made_up_impacts_are_covered_as_stated(posterior):
    """The check is by other data sets, with their truths, of the same laws."""
    assert posterior.calibration.passed
    assert posterior.calibration.near is None
    assert posterior.calibration.as_dict()["held_out_strings"] == 0


def test_90_per_cent_regions_hold_the_truths_of_made_up_impacts(box):
    """Of 200 truths 180 ± 4.24 are expected."""
    random, strings = np.random.default_rng(3), box.even_strings(1 << 11)
    predicted = np.array([coefficients(box, s) for s in strings])
    held = 0
    for place in random.uniform(0.1, 0.9, (200, 2)):
        truth = truth_of(box, place)
        values = coefficients(box, truth) + ERROR * random.normal(size=len(SPEEDS))
        logarithms = -0.5 * np.sum(((values - predicted) / ERROR) ** 2, axis=1)
        weights = np.exp(logarithms - logarithms.max())
        own = emulator_of(box, values).log_density(truth[None])[0] - logarithms.max()
        falling = np.sort(weights)[::-1]
        reached = np.cumsum(falling) / falling.sum()
        held += bool(math.exp(own) >= falling[np.searchsorted(reached, 0.9)])
    assert held == pytest.approx(180, abs=4.5 * 4.24)


def test_the_predictive_check_knows_impacts_without_an_emulator(box, posterior):
    [predicted] = posterior.predictions
    assert predicted.p_value > 1e-3
    assert not predicted.outside
    middle = posterior.weights @ posterior.strings
    assert predicted.median == pytest.approx(coefficients(box, middle), abs=ERROR)
    [wrong], p_value = predict_data(emulator_of(box, 1.0 - predicted.datum.values), posterior)
    assert wrong.disagrees
    assert p_value == wrong.p_value


@pytest.mark.slow(guard="inference/test_expected_volume.py")
def test_a_repetition_with_half_of_the_error_shrinks_the_region_as_fisher_says(posterior):
    """Five times the information: a region of two variables has 1/5 of the volume."""
    of = posterior.of
    strings, points = dense_points(of, posterior)
    [(_, again)] = measurables(None, of, strings, points, {})
    after = expected_volume(points, again, np.random.default_rng(1))
    assert after.value / points.volume == pytest.approx(0.2, rel=0.1)


class LinearBox(SearchedBox):
    """The box of a small campaign, whose strings have the exact value u − v of their place."""

    def __init__(self, folder):
        super().__init__(load_campaign(write_measured(folder)))
        own = self

        class Tests:
            def __init__(self, string):
                self.place = own.space.to_unit(np.asarray(string)[None])[0]

            def coefficients(self, impacts, solve):
                return np.array([self.place[0] - self.place[1]])

        class Campaign:
            def __getattr__(self, name):
                return getattr(own.whole, name)

            def impact_tests_at(self, string, experiment):
                return Tests(string)

        self.whole, self.campaign = self.campaign, Campaign()


def test_emulated_and_exact_data_have_the_posterior_of_generalised_least_squares(tmp_path):
    """A value 1 + u by samples, and u − v without; in either order of the data."""
    box, errors = LinearBox(tmp_path), np.array([0.05, 0.03])
    random = np.random.default_rng(1)
    places = random.random((STRINGS, 2))
    which = np.repeat(np.arange(STRINGS), SAMPLES)
    sampled = 1.0 + places[which, 0] + NOISE * random.normal(size=len(which))
    strings = box.space.from_unit(places)
    stored = StoredSamples(strings[which], np.empty(len(which)), strings, np.zeros(STRINGS, bool))
    [number] = measurements([1.45], errors[:1])
    exact = Datum(
        "restitution", np.array([0.1]), np.array([[errors[1] ** 2]]), impacts=np.ones((1, 4))
    )
    slopes, measured = np.array([[1.0, 0.0], [1.0, -1.0]]), np.array([0.45, 0.1])
    precision = slopes.T @ np.diag(errors**-2.0) @ slopes
    expected = np.linalg.solve(precision, slopes.T @ (measured / errors**2))
    deviation = np.sqrt(np.diag(np.linalg.inv(precision)))
    exact_sampled = places[which, 0] - places[which, 1]
    for data, columns in (
        ((number, exact), (sampled, exact_sampled)),
        ((exact, number), (exact_sampled, sampled)),
    ):
        values = StringValues(strings[which], np.column_stack(columns))
        found = single_threaded(posterior_of)(EmulatedData(box, data, values, stored))
        place = box.space.to_unit(found.strings)
        size = found.effective_size
        mean = found.weights @ place
        # The emulator knows its value to some 0.01, which widens the posterior by a few percent.
        assert np.all(np.abs(mean - expected) < 4.0 * deviation / np.sqrt(size) + 0.25 * deviation)
        ratio = np.linalg.eigvals(np.cov(place.T, aweights=found.weights) @ precision).real
        assert np.all(np.abs(np.sqrt(ratio) - 1.0) < 4.0 / np.sqrt(2.0 * size) + 0.08)
        assert found.calibration.passed
        # All of the density is inside of the box: its integral is the area of its unit.
        evidence = single_threaded(evidence_of)(found.of, found)
        area = math.prod(errors) / abs(np.linalg.det(slopes))
        assert abs(evidence.logarithm - math.log(area)) < 4.0 * evidence.error + 0.03
        by_name = {each.datum.quantity: each for each in found.predictions}
        assert by_name["restitution"].median[0] == pytest.approx(0.1, abs=0.06)
        assert by_name["mean_diameter"].median[0] == pytest.approx(1.45, abs=0.1)
        draws = found.of.measurements(found.strings[:1].repeat(4000, 0), random, given=False)
        spread = draws[data.index(exact)].std()
        assert spread == pytest.approx(0.03, rel=4.0 / np.sqrt(8000))


def test_strings_that_a_law_refuses_have_no_density(box, posterior, monkeypatch):
    def refuse(string):
        raise ValueError("no such law")

    strings = box.even_strings(4)
    monkeypatch.setattr(
        type(box.campaign), "impact_tests_at", lambda self, string, _: refuse(string)
    )
    assert np.all(np.isneginf(posterior.of.log_density(strings)))
