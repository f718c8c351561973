"""Censuses of particles whose distribution is known."""

import math

import numpy as np
from scipy.special import ndtr

from agglom_mpi.measurements.census import Census
from agglom_mpi.measurements.layout import CensusLayout

DENSITY = 2500.0


def bins(smallest, largest):
    """Return the edges of bins that hold diameters between two, in m, as a campaign's are."""
    layout = CensusLayout.between((math.inf,), 1.0, largest / smallest)
    return smallest * layout.edges


def counted_covariance(shares, counted):
    """Return the covariance of the shares of so many independently counted particles, (q, q).

    (diag(p) - p pT)/counted, where p has half a particle more in each class (Jeffreys), so that an
    empty class has an error as well.
    """
    measured = np.asarray(shares, float)
    p = (counted * measured + 0.5) / (counted + 0.5 * len(measured))
    return (np.diag(p) - np.outer(p, p)) / counted


def expected_census(median, log_spread, samples=1, grains=1000):
    """Return samples that have exactly a lognormal distribution by number, at one time."""
    width = 9.0 * log_spread
    edges = bins(median * math.exp(-width), median * math.exp(width + 3 * log_spread**2))
    scaled = np.log(edges / median) / log_spread
    counts = grains * np.diff(ndtr(scaled))
    mean_mass = DENSITY * math.pi / 6.0 * median**3 * math.exp(4.5 * log_spread**2)
    masses = grains * mean_mass * np.diff(ndtr(scaled - 3.0 * log_spread))
    shape = (samples, 1, 1)
    constant = np.ones((samples, 1))
    return Census(
        edges,
        np.tile(counts, shape),
        np.tile(masses, shape),
        300.0 * constant,
        np.sum(masses) * constant,
        grains,
        DENSITY,
    )


def census_of(diameters, times, edges, grains, temperatures=None):
    """Return the census of particles: diameters[sample][time] in m."""
    bins = len(edges) - 1
    counts, masses = np.zeros((2, len(diameters), times, bins))
    largest = np.zeros((len(diameters), times))
    for sample, histories in enumerate(diameters):
        for time, sizes in enumerate(histories):
            places = np.clip(np.searchsorted(edges, sizes, side="right") - 1, 0, bins - 1)
            mass = DENSITY * math.pi / 6.0 * np.asarray(sizes) ** 3
            counts[sample, time] = np.bincount(places, minlength=bins)
            masses[sample, time] = np.bincount(places, mass, minlength=bins)
            largest[sample, time] = np.max(mass, initial=0.0)
    if temperatures is None:
        temperatures = np.full((len(diameters), times), 300.0)
    return Census(edges, counts, masses, temperatures, largest, grains, DENSITY)


def drawn_census(samples, rng, median=1e-4, log_spread=0.3, grains=100, times=1):
    """Return samples of `grains` grains, of which a random number is left at each time.

    Half of the grains are left on average, and their diameters are lognormal by number.
    """
    edges = bins(0.1 * median, 10.0 * median)
    diameters = [
        [
            median * np.exp(log_spread * rng.standard_normal(rng.binomial(grains, 0.5)))
            for _ in range(times)
        ]
        for _ in range(samples)
    ]
    return census_of(
        diameters, times, edges, grains, 300.0 + 10.0 * rng.standard_normal((samples, times))
    )
