"""Laws compared: refusals, verdicts, data left out, and probabilities that are calibrated."""

import copy
import dataclasses
import json
import math

import numpy as np
import pytest
from scipy.special import chdtrc
from toy_posteriors import correlated, linear_emulator, measurements

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.contributions import conditional_densities, datum_points
from agglom_mpi.inference.data_posterior import posterior_of
from agglom_mpi.inference.evidence import Evidence, evidence_of
from agglom_mpi.inference.law_comparison import (
    DECIDED,
    ComparedLaw,
    LawComparison,
    LeftOut,
    compare_files,
    compared_law,
    different_data,
)
from agglom_mpi.inference.posterior import Posterior, PosteriorError
from agglom_mpi.inference.posterior_sampling import WeightedStrings, effective_size
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.measurements.misfit import ResidualFrame

FIRST = np.array([[1.0, 0.0], [1.0, 1.0], [0.5, -0.5], [0.0, 1.0], [0.3, 0.7]])
SECOND = np.array([[1.0, 0.2], [0.7, 1.0], [0.3, -0.2], [0.2, 0.6], [0.5, 0.8]])
THIRD = np.array([[-0.5, 0.9], [0.9, -0.6], [0.9, 0.9], [-0.9, 0.5], [1.2, -0.9]])
TRUTH = np.array([0.45, 0.6])
COUNT = 60
ERRORS = np.tile([0.05, 0.04, 0.06, 0.05, 0.05], COUNT // 5)
CORRELATIONS = np.eye(COUNT) + 0.4 * (np.eye(COUNT, k=1) + np.eye(COUNT, k=-1))
REPEATED = np.vstack([FIRST] * (COUNT // 5))
"""With so many data, no single one matters so much that its weights have heavy tails."""


def law_of(name, logarithm, p_value=0.5, error=0.01, inside=("u",), size=2000.0, left_out=None):
    """Return a law of which only evidence, p-value and densities of data left out are known."""

    class Known:
        pass

    Known.p_value = p_value
    evidence = Evidence(logarithm, error, size, inside, ())
    return ComparedLaw(name, Known(), evidence, left_out)


def test_probabilities_are_those_of_equal_odds():
    found = LawComparison((law_of("a", 2.0), law_of("b", 2.0 + math.log(3.0))))
    assert found.probabilities == pytest.approx([0.25, 0.75])
    assert found.best.name == "b"
    assert found.order == [1, 0]
    # The evidence of a law whose box alone is doubled is half of what it was.
    assert found.probabilities_if_doubled == pytest.approx([1.0 / 7.0, 0.6])
    assert found.deciding is None


@pytest.mark.parametrize(
    ("laws", "explained", "decided"),
    [
        ([("a", 0.0, 0.5), ("b", -4.0, 0.2)], True, True),
        ([("a", 0.0, 0.5), ("b", -1.0, 0.2)], True, False),
        ([("a", 0.0, 0.01), ("b", -9.0, 0.02)], False, False),
        ([("a", 0.0, 0.01), ("b", -9.0, 0.2)], True, False),
        ([("a", 0.0, 0.5, 0.5), ("b", -3.2, 0.5, 0.5)], True, False),  # within the errors
        ([("a", 0.0, 0.5, 0.01, (), 50.0), ("b", -9.0, 0.5)], True, False),
    ],
)
def test_a_verdict_needs_probability_fit_and_small_errors(laws, explained, decided):
    found = LawComparison(tuple(law_of(*each) for each in laws))
    assert (found.explained, found.is_decided) == (explained, decided)
    entries = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert (entries["explained"], entries["decided"]) == (explained, decided)
    assert entries["laws"][0]["law"] == "a"
    assert entries["verdict"] == found.verdict
    assert "\n" not in found.verdict
    assert found.verdict.startswith("none explains") == (not explained)
    assert found.verdict.startswith("not decided") == (explained and not decided)


def test_the_experiment_that_decides_has_the_largest_sum_of_its_data():
    def left_out(*densities, experiments=("slow", "fast", "fast")):
        return LeftOut(("a", "b", "c"), experiments, np.array(densities), np.zeros(3))

    first, second = left_out(-1.0, -2.0, -2.5), left_out(-2.5, -1.0, -1.5)
    found = LawComparison((law_of("x", 0.0, left_out=first), law_of("y", -1.0, left_out=second)))
    assert found.deciding == ("a", 1.5)
    assert found.deciding_experiment == ("fast", -2.0)
    entries = found.as_dict()
    assert entries["deciding"] == {"datum": "a", "log_density_difference": 1.5}
    assert entries["deciding_experiment"] == {"experiment": "fast", "log_density_difference": -2.0}
    one = left_out(-1.0, -2.0, -2.5, experiments=("", "", ""))
    found = LawComparison((law_of("x", 0.0, left_out=one), law_of("y", -1.0, left_out=second)))
    assert found.as_dict()["deciding_experiment"] is None


def test_data_that_differ_in_values_errors_or_kind_are_told_apart():
    data = measurements([1.0, 2.0], [0.1, 0.2])
    assert different_data(data, measurements([1.0, 2.0], [0.1, 0.2])) == ""
    assert different_data(correlated(data, np.eye(2)), data) == ""
    kinds = [dataclasses.replace(data[0], time=1.0), data[1]]
    correlations = correlated(data, np.array([[1.0, 0.5], [0.5, 1.0]]))
    values, errors = measurements([1.0, 2.1], [0.1, 0.2]), measurements([1.0, 2.0], [0.1, 0.3])
    for other in (data[:1], kinds, correlations, values, errors, data[::-1]):
        assert different_data(data, other)
        assert different_data(other, data)


class File:
    """A campaign file of which only data and posterior are known."""

    def __init__(self, path, data, passed=True):
        self.path, self._data, self._passed = path, data, passed

    def derived(self, function):
        class Calibration:
            passed, text = self._passed, "the posterior is not calibrated"

        class Known:
            calibration = Calibration()

        return Known()


def test_each_campaign_that_cannot_be_compared_is_refused(monkeypatch, tmp_path):
    data = measurements([1.0], [0.1])

    def campaign(file):
        class Objective:
            needs_data = file._data is not None

        class Campaign:
            data, objective = file._data or (), Objective()

        return Campaign()

    monkeypatch.setattr("agglom_mpi.inference.law_comparison.recorded_campaign", campaign)
    a, b = tmp_path / "a.h5", tmp_path / "b.h5"
    refused = {
        "at least two": [File(a, data)],
        f"{b}: objective": [File(a, data), File(b, None)],
        f"{b}: data": [File(a, data), File(b, measurements([1.0], [0.2]))],
        f"{b}: the posterior": [File(a, data), File(b, data, passed=False)],
    }
    for text, files in refused.items():
        with pytest.raises(PosteriorError) as error:
            compare_files(files)
        assert text in str(error.value)
        assert "\n" not in str(error.value)


def impacts(covariance):
    rows = np.column_stack([np.arange(1.0, 4.0), np.ones(3), np.ones(3), np.full(3, np.nan)])
    return Datum("restitution", np.array([0.9, 0.8, 0.7]), covariance, impacts=rows, name="list")


def test_each_impact_of_a_list_is_left_out_alone_and_a_curve_as_a_whole():
    errors = np.array([0.01, 0.02, 0.04])
    shared = np.outer(errors, errors) * (np.eye(3) + 0.3 * (1.0 - np.eye(3)))
    edges = np.array([0.0, 1.0, 2.0, 3.0])
    curve = Datum("sizes", np.array([0.2, 0.5, 0.3]), 0.01 * np.eye(3), edges=edges, name="curve")

    class Known:
        data = (curve, impacts(shared))
        frame = ResidualFrame(data)

    points, turned = datum_points(Known)
    assert [name.partition(":")[0] for name, *_ in points] == ["curve", *["list"] * 3]
    assert [own.stop - own.start for *_, own in points] == [2, 1, 1, 1]
    away = np.array([0.0, 0.0, 0.0, 0.03, -0.01, 0.02])
    residuals = turned @ (away @ Known.frame.basis)
    assert residuals[2:] == pytest.approx(away[3:] / errors)
    # The frame's covariance is 1, that of residuals over their errors are the correlations.
    correlations = (turned @ turned.T)[2:, 2:]
    assert correlations == pytest.approx(shared / np.outer(errors, errors))


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """Posterior of correlated data of the first law, which it fits well."""
    random = np.random.default_rng(4)
    root = np.linalg.cholesky(CORRELATIONS * np.outer(ERRORS, ERRORS))
    values = 1.0 + REPEATED @ TRUTH + root @ random.normal(size=COUNT)
    data = correlated(measurements(values, ERRORS), CORRELATIONS)
    folder = tmp_path_factory.mktemp("first")
    return single_threaded(posterior_of)(linear_emulator(folder, REPEATED, data, noise=1e-3))


@pytest.fixture(scope="module")
def second(first, tmp_path_factory):
    folder = tmp_path_factory.mktemp("second")
    return single_threaded(posterior_of)(
        linear_emulator(folder, np.vstack([SECOND] * (COUNT // 5)), first.of.data, noise=1e-3)
    )


def test_the_density_of_a_datum_is_that_of_all_over_that_of_the_others(first):
    strings = first.strings[:3]
    found = conditional_densities(first.of, strings)
    away, covariances = first.of.framed_residuals(strings)
    roots = first.of.frame.roots
    for i in range(COUNT):
        others = np.delete(np.arange(COUNT), i)
        for n in range(3):
            own, r = roots @ covariances[n] @ roots.T, roots @ away[n]
            inner = own[np.ix_(others, others)]
            gain = np.linalg.solve(inner, own[others, i])
            mean, variance = gain @ r[others], own[i, i] - gain @ own[others, i]
            expected = -0.5 * ((r[i] - mean) ** 2 / variance + math.log(2 * math.pi * variance))
            assert found[n, i] == pytest.approx(expected)


def test_data_left_out_have_the_density_of_generalised_least_squares(first):
    """With P = C⁻¹ − C⁻¹X(XᵀC⁻¹X)⁻¹XᵀC⁻¹ the residual is (P r)_i/P_ii, of variance 1/P_ii."""
    pytest.importorskip("arviz")
    found = compared_law("first", first).left_out
    slopes, inverse = REPEATED / ERRORS[:, None], np.linalg.inv(CORRELATIONS)
    gained = inverse @ slopes
    precision = inverse - gained @ np.linalg.solve(slopes.T @ gained, gained.T)
    residuals = (np.array([datum.values[0] for datum in first.of.data]) - 1.0) / ERRORS
    own = np.diag(precision)
    expected = 0.5 * (np.log(own / (2 * np.pi)) - (precision @ residuals) ** 2 / own)
    assert found.unreliable == 0
    # Smoothed weights of a thousand draws; each density errs by a few percent.
    assert found.densities == pytest.approx(expected, abs=0.15)
    assert found.total == pytest.approx(expected.sum(), abs=0.5)


def test_arviz_compares_files_of_draws_as_we_do(first, second):
    arviz = pytest.importorskip("arviz")
    laws = [compared_law("first", first), compared_law("second", second)]
    found = LawComparison(tuple(laws))
    table = arviz.compare({"first": first.to_arviz(), "second": second.to_arviz()})
    column = next(name for name in table.columns if name in ("elpd_loo", "elpd"))
    for law in laws:
        assert float(table.loc[law.name, column]) == pytest.approx(law.left_out.total)
    ours = sorted(laws, key=lambda law: -law.left_out.total)
    assert list(table.index) == [law.name for law in ours]
    apart = laws[found.order[0]].left_out.densities - laws[found.order[1]].left_out.densities
    name, difference = found.deciding
    assert abs(difference) == pytest.approx(np.abs(apart).max())
    assert name == f"number {np.argmax(np.abs(apart))}"


def given(of, values):
    """Return an emulator with other values of the same data."""
    found = copy.copy(of)
    found.__dict__.pop("_nearest", None)
    found.frame = copy.copy(of.frame)
    found.frame.measured = values
    found.measured = of.numbers_of(values)
    found.left_out_measured = (values @ of.frame.basis - of.centre) @ of.left_out
    return found


@single_threaded
def quick_law(name, of, values, strings):
    """Return a law by its density at even strings of the box, and the p-value of the best."""
    own = given(of, values)
    logarithms = own.log_density(strings)
    weights = np.exp(logarithms - logarithms.max())
    size = effective_size(weights)
    drawn = WeightedStrings(strings, weights / weights.sum(), size, "importance weights", 0, 1.0)
    posterior = Posterior(**vars(drawn), of=own)
    away, covariances = own.framed_residuals(strings[logarithms.argmax()][None])
    best = chdtrc(len(values), away[0] @ np.linalg.solve(covariances[0], away[0]))
    return ComparedLaw(name, posterior, evidence_of(own, drawn), None), float(best)


class Toys:
    """Two laws with emulators of noisy samples, and data sets that are made up."""

    def __init__(self, make):
        self.random, self.errors = np.random.default_rng(2), np.full(5, 0.12)
        data = measurements(np.ones(5), self.errors)
        self.laws = [
            linear_emulator(make(str(i)), slopes, data, noise=0.1)
            for i, slopes in enumerate((FIRST, SECOND))
        ]
        self.strings = [of.box.even_strings(1 << 11) for of in self.laws]

    def compared(self, slopes):
        """Return the comparison by data of a law, and the largest p-value of a best string."""
        truth = slopes @ self.random.random(2)
        values = 1.0 + truth + self.errors * self.random.normal(size=5)
        pairs = zip("ab", self.laws, self.strings, strict=True)
        laws, best = zip(*(quick_law(n, of, values, s) for n, of, s in pairs), strict=True)
        return LawComparison(laws), max(best)


@pytest.fixture(scope="module")
def toys(tmp_path_factory):
    return single_threaded(Toys)(tmp_path_factory.mktemp)


def reliability(stated, outcomes):
    """Return the probability that stated probabilities are off by more, of all and of sharp ones.

    Calibration in the large, Σ(z − p), and Spiegelhalter's Σ(z − p)(1 − 2p), jointly: χ² of two.
    """
    away, variance = outcomes - stated, stated * (1.0 - stated)
    directions = np.stack([np.ones(len(stated)), 1.0 - 2.0 * stated])
    sums = directions @ away
    return chdtrc(2, sums @ np.linalg.pinv((directions * variance) @ directions.T) @ sums)


@pytest.mark.slow(guard="inference/test_law_comparison.py")
def test_stated_probabilities_are_calibrated(toys):
    """100 made-up data sets, half of each law; 1 of 10 000 fails by chance."""
    outcomes = np.arange(100) % 2 == 0
    found = [toys.compared(FIRST if is_first else SECOND)[0] for is_first in outcomes]
    stated = np.array([each.probabilities[0] for each in found])
    assert reliability(stated, outcomes) > 1e-4
    likely = np.maximum(stated, 1.0 - stated)
    right = np.sum((stated > 0.5) == outcomes)
    spread = math.sqrt(np.sum(likely * (1.0 - likely)))
    assert right > likely.sum() - 4.0 * spread
    # The test has something to say: some are decided, some are not, and a true law fits.
    decided = [each for each in found if each.is_decided]
    assert 10 <= len(decided) <= 95
    assert np.mean([likely[i] < DECIDED for i in range(100)]) > 0.05
    assert sum(not each.explained for each in found) <= 15


@pytest.mark.slow(guard="inference/test_law_comparison.py")
def test_data_of_a_third_law_are_explained_by_none(toys):
    """In at least 80 % of the cases in which both laws miss them with p < 0.01."""
    found = [toys.compared(THIRD) for _ in range(40)]
    missed = [each for each, best in found if best < 0.01]
    assert len(missed) >= 10
    assert np.mean([not each.explained for each in missed]) >= 0.8
