import importlib.util
import warnings

import numpy as np
import pytest

from agglom_mpi.errors import MissingLibraryError
from agglom_mpi.inference.draw_groups import PRIOR_DRAWS

NAMES = {"relative_speed", "hardness", "friction"}


@pytest.fixture(scope="module")
def posterior(doubling):
    return doubling.posterior(2.0, 0.05)


@pytest.fixture(scope="module")
def data(posterior):
    pytest.importorskip("arviz")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of ArviZ, on its next version
        return posterior.to_arviz(draws=3000, seed=5)


def test_draws_have_the_mean_of_the_weighted_strings(posterior, data):
    draws = posterior.to_pandas()
    assert draws["weight"].sum() == pytest.approx(1.0)
    for name in NAMES:
        values, weights = draws[name].to_numpy(), draws["weight"].to_numpy()
        mean = weights @ values
        error = np.sqrt(weights @ (values - mean) ** 2 / 3000)
        found = data.posterior[name]
        assert found.shape == (1, 3000)
        assert abs(float(found.mean()) - mean) < 4.0 * error
        assert found.attrs["units"] == draws.attrs["units"][name]


def test_groups_are_those_of_arviz(data, posterior):
    assert set(data.posterior.data_vars) == set(data.prior.data_vars) == NAMES
    assert data.prior.sizes == {"chain": 1, "draw": PRIOR_DRAWS}
    assert float(data.observed_data["mean_radius_ratio"][0]) == 2.0
    assert float(data.constant_data["mean_radius_ratio_standard_error"][0]) == 0.05
    assert data.sample_stats["weight"].max() <= posterior.weights.max()
    assert data.posterior.attrs["effective_size"] == posterior.effective_size
    assert data.attrs["campaign"] == posterior.of.box.campaign.text


def test_predicted_measurements_scatter_about_the_measured_mean(data):
    """Around a mean that is known as well as it was measured, with the same error once more."""
    values = data.posterior_predictive["mean_radius_ratio"].to_numpy()
    assert abs(values.mean() - 2.0) < 0.05
    assert 0.05 < values.std() < 0.05 * np.sqrt(2.0) * 1.2
    assert data.prior_predictive["mean_radius_ratio"].std() > 4.0 * values.std()


def test_walkers_of_a_chain_are_its_chains(doubling, monkeypatch):
    pytest.importorskip("xarray")
    pytest.importorskip("emcee")
    monkeypatch.setattr("agglom_mpi.inference.posterior_sampling.MIN_SIZE", 1e9)
    chain = doubling.posterior(2.0, 0.05)
    found = chain.groups()["posterior"]["hardness"]
    assert found.shape == (32, 400)
    walker = found.to_numpy()[7]
    assert walker.tolist() == chain.draws["hardness"].to_numpy()[7::32].tolist()
    # A walker often stays where it is; the strings of different walkers differ.
    assert np.mean(walker[1:] == walker[:-1]) > 0.2


@pytest.mark.parametrize("missing", ["arviz", "xarray"])
def test_without_a_library_the_message_names_what_to_install(posterior, monkeypatch, missing):
    find = importlib.util.find_spec
    without = lambda name, *rest: None if name == missing else find(name, *rest)  # noqa: E731
    monkeypatch.setattr(importlib.util, "find_spec", without)
    with pytest.raises(MissingLibraryError, match=rf"{missing}.*agglom_mpi\[arviz\]"):
        posterior.to_arviz()


def test_a_number_of_draws_is_a_whole_number(posterior):
    with pytest.raises(ValueError, match=r"draws: .*1\.5"):
        posterior.to_arviz(draws=1.5)
