"""What each experiment contributes, of data that are linear in two variables."""

import dataclasses

import numpy as np
import pytest
from toy_posteriors import linear_emulator, measurements

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.contributions import DataOfSome, contributions
from agglom_mpi.inference.data_posterior import posterior_of

SLOPES = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
TRUTH = np.array([0.5, 0.5])
ERRORS = np.array([0.05, 0.05, 0.1])
NAMES = ("first", "second", "both")


@pytest.fixture(scope="module")
def emulated(tmp_path_factory):
    data = measurements(1.0 + SLOPES @ TRUTH, ERRORS)
    data = [dataclasses.replace(d, experiment=n) for d, n in zip(data, NAMES, strict=True)]
    return linear_emulator(tmp_path_factory.mktemp("toy"), SLOPES, data)


@pytest.fixture(scope="module")
def posterior(emulated):
    return single_threaded(posterior_of)(emulated)


def test_the_density_of_some_data_is_that_of_these_alone(emulated):
    """The emulator knows each value to some 0.01, far better than it is measured."""
    strings = emulated.box.even_strings(64)
    places = emulated.box.space.to_unit(strings)
    for name, slope, error in zip(NAMES, SLOPES, ERRORS, strict=True):
        found = DataOfSome(emulated, (name,)).log_density(strings)
        expected = -0.5 * ((places - TRUTH) @ slope / error) ** 2
        near = expected > -8.0
        away = (found - expected)[near]
        assert np.ptp(away) < 0.15 * np.abs(expected[near]).max() + 0.3


def test_all_data_have_the_density_of_the_posterior(emulated):
    strings = emulated.box.even_strings(64)
    difference = DataOfSome(emulated, NAMES).log_density(strings) - emulated.log_density(strings)
    assert np.ptp(difference) < 1e-6 * np.abs(emulated.log_density(strings)).max()


def test_the_contraction_without_an_experiment_is_that_of_the_others(posterior):
    rows = {each.label: each for each in posterior.contributions}
    assert list(rows) == [
        "all",
        *(f"without {name}" for name in NAMES),
        *(f"{name} alone" for name in NAMES),
    ]
    assert rows["all"].contraction == posterior.contraction
    first, second = posterior.of.box.names
    assert rows["first alone"].contraction[second] > 0.9
    assert rows["first alone"].contraction[first] < 0.3
    for label in list(rows)[1:]:
        assert rows[label].volume > rows["all"].volume
    precision = SLOPES[1:].T @ np.diag(ERRORS[1:] ** -2.0) @ SLOPES[1:]
    widths = 2.0 * 1.645 * np.sqrt(np.diag(np.linalg.inv(precision))) / 0.9
    found = [rows["without first"].contraction[name] for name in (first, second)]
    assert found == pytest.approx(widths, rel=0.2)


def test_data_of_one_experiment_have_no_table(tmp_path):
    data = measurements(1.0 + SLOPES @ TRUTH, ERRORS)
    assert contributions(linear_emulator(tmp_path, SLOPES, data), None) == []
