"""The examples in jobs/python find what they ask for."""

import runpy
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[1] / "jobs" / "python"


@pytest.mark.slow
def test_the_posterior_by_draws_is_that_on_a_grid():
    pytest.importorskip("emcee")
    example = runpy.run_path(str(EXAMPLES / "posterior.py"))
    draws = example["draw"](steps=60)
    assert draws.shape == (32 * 40, 2)
    axes = [np.linspace(*ends, 42)[1:-1] for ends in ((2.0, 6.0), (0.4, 0.7))]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    weights = np.exp(example["log_probability"](grid))
    mean = np.average(grid, axis=0, weights=weights)
    spread = np.sqrt(np.average((grid - mean) ** 2, axis=0, weights=weights))
    # Some 30 of the draws are independent: their mean has a fifth of the spread as its error.
    assert (abs(draws.mean(axis=0) - mean) < 0.6 * spread).all()
    assert (abs(np.log(draws.std(axis=0) / spread)) < 0.5).all()


@pytest.mark.slow(guard="verbs/test_simulate_many.py")
def test_optuna_comes_near_to_grains_that_double():
    pytest.importorskip("optuna")
    example = runpy.run_path(str(EXAMPLES / "minimise.py"))
    study = example["minimise"](generations=4)
    assert len(study.trials) == 32
    first = [trial.value for trial in study.trials[:8]]
    fresh = example["CAMPAIGN"].simulate_many(study.best_params, samples=200, first_sample=1000)
    assert abs(fresh.mean_radius_ratio.mean() / 2.0 - 1.0) < min(0.1, np.median(first))
