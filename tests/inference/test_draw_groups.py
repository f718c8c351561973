import importlib.util
import sys
import types
import warnings

import numpy as np
import pytest

from agglom_mpi.errors import MissingLibraryError
from agglom_mpi.inference.draw_groups import (
    CHAINS,
    PRIOR_DRAWS,
    arviz_data,
    in_chains,
    independent_draws,
)

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
        found = data.posterior[name]
        error = np.sqrt(weights @ (values - mean) ** 2 / found.size)
        assert abs(float(found.mean()) - mean) < 4.0 * error
        assert found.attrs["units"] == draws.attrs["units"][name]


def test_draws_are_distinct_and_no_more_than_the_effective_size(data, posterior):
    found = data.posterior["hardness"].to_numpy()
    assert found.shape[0] == CHAINS
    assert len(np.unique(found)) == found.size <= data.posterior.attrs["effective_size"]
    assert found.size > 0.9 / posterior.weights.max()


def test_arviz_takes_the_draws_for_independent_ones(data):
    """R-hat of independent draws is 1; their effective size is their number but for estimation.

    Of normal draws the estimate has a deviation of 5 %, more so downwards; here it is the least of
    several variables.
    """
    arviz = pytest.importorskip("arviz")
    for group in ("posterior", "prior"):
        found = arviz.summary(data, group=group)
        assert found["r_hat"].max() < 1.03
        assert found["ess_bulk"].min() > 0.7 * data[group].sizes["draw"] * CHAINS


def test_strings_are_drawn_with_their_weights():
    """The number of draws of half of the weight is its expectation, within one."""
    weights = np.array([0.05, 0.15, 0.1, 0.2, 0.05, 0.25, 0.1, 0.1])
    counts = np.zeros(8)
    for seed in range(400):
        chosen = independent_draws(weights, 100, seed)
        assert len(chosen) == len(set(chosen)) == 4
        counts[chosen] += 1
    expected = 400 * 4 * weights
    assert np.all(np.abs(counts - expected) <= 4.5 * np.sqrt(400 * 4 * weights * (1 - 4 * weights)))


@pytest.mark.parametrize(("draws", "shape"), [(1, (1, 1)), (15, (1, 15)), (19, (4, 4))])
def test_few_draws_are_one_chain(draws, shape):
    assert in_chains(np.arange(draws)).shape == shape


@pytest.mark.parametrize("later", [False, True])
def test_groups_become_what_the_line_of_arviz_has(monkeypatch, later):
    """From ArviZ 1 on InferenceData is no attribute of the module, but DataTree with a warning."""
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("arviz")
    module = types.ModuleType("arviz")
    module.__spec__ = importlib.util.find_spec("arviz")

    def getter(name):
        warnings.warn(f"{name} is DataTree", FutureWarning, stacklevel=1)
        return xarray.DataTree

    if later:
        module.__getattr__ = getter
    else:
        module.InferenceData = lambda attrs, **groups: types.SimpleNamespace(attrs=attrs, **groups)
    monkeypatch.setitem(sys.modules, "arviz", module)
    found = arviz_data({"posterior": xarray.Dataset({"a": ("draw", [1.0, 2.0])})}, {"seed": 3})
    assert isinstance(found, xarray.DataTree) is later
    assert found.attrs["seed"] == 3
    assert found.posterior["a"].to_numpy().tolist() == [1.0, 2.0]


def test_groups_are_those_of_arviz(data, posterior):
    assert set(data.posterior.data_vars) == set(data.prior.data_vars) == NAMES
    assert data.prior.sizes == {"chain": CHAINS, "draw": PRIOR_DRAWS // CHAINS}
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
    monkeypatch.setattr("agglom_mpi.inference.posterior_sampling.CHAIN_STEPS", 90)
    chain = doubling.posterior(2.0, 0.05)
    found = chain.groups()["posterior"]["hardness"]
    assert found.shape == (32, 60)
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
