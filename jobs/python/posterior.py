"""Posterior of speed and seeding by a measured growth, with emcee: `python posterior.py`."""

from pathlib import Path

import emcee
import numpy as np

from agglom_mpi import load_campaign

CAMPAIGN = load_campaign(Path(__file__).parents[1] / "story" / "growth_by_half.yaml")
NAMES = ("relative_speed", "size_ratio")
LOWER, UPPER = np.array([0.5, 0.4]), np.array([10.0, 0.7])
MEASURED, ERROR, SAMPLES = 1.5, 0.03, 10


def log_probability(points):
    """Return the log of the posterior density at points, (m, 2): uniform prior, normal error."""
    found = np.full(len(points), -np.inf)
    inside = ((points > LOWER) & (points < UPPER)).all(axis=1)
    columns = dict(zip(NAMES, points[inside].T, strict=True))
    growth = CAMPAIGN.simulate_many(columns, samples=SAMPLES).mean_radius_ratio
    variance = ERROR**2 + growth.var(axis=1, ddof=1) / SAMPLES  # of the measurement and the mean
    found[inside] = -0.5 * ((growth.mean(axis=1) - MEASURED) ** 2 / variance + np.log(variance))
    return np.nan_to_num(found, nan=-np.inf)  # where samples have failed


def draw(steps, walkers=32, seed=1):
    """Return draws of the posterior, (n, 2); the first third of the steps is left out."""
    random = np.random.RandomState(seed)
    sampler = emcee.EnsembleSampler(walkers, 2, log_probability, vectorize=True)
    sampler.random_state = random.get_state()
    sampler.run_mcmc(random.uniform([2.0, 0.42], [4.0, 0.5], (walkers, 2)), steps)
    return sampler.get_chain(discard=steps // 3, flat=True)


if __name__ == "__main__":
    for name, values in zip(NAMES, draw(steps=150).T, strict=True):
        print("{}: {:.3g} ({:.3g} to {:.3g})".format(name, *np.percentile(values, [50, 2.5, 97.5])))
    # relative_speed: 3.39 (2.87 to 4.02)
    # size_ratio: 0.543 (0.408 to 0.695)
