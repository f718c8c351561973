"""Posteriors beside direct simulations: data of known truths, and the posterior on a grid."""

import copy
import itertools
from dataclasses import replace

import numpy as np

from agglom_mpi.inference.data_emulator import EmulatedData
from agglom_mpi.inference.posterior_sampling import PRIOR_POINTS, sample_posterior
from agglom_mpi.inference.stored_samples import pseudo_values, stored_samples, string_values
from agglom_mpi.verbs.simulate import simulate

FIRST_SAMPLE = 5000
"""Number of the first sample: other samples than those of a file."""
GRID = (41, 11, 11)
"""Strings along each principal axis, the longest first."""
REACH = 3.5
"""Ends of the grid, in standard deviations of the posterior."""


def predicted(campaign, string, data, samples, first=FIRST_SAMPLE):
    """Return pseudo-values of new samples of a string for data, (samples, Q)."""
    numbers = range(first, first + samples)
    if not campaign.experiments:
        return pseudo_values(_census(campaign, string, numbers), data)
    own = [(each.name, each.campaign, each.own(string)) for each in campaign.experiments]
    names = {datum.experiment for datum in data}
    censuses = {name: _census(alone, s, numbers) for name, alone, s in own if name in names}
    return pseudo_values(censuses, data)


def _census(campaign, string, numbers):
    censuses = [simulate(campaign, string, k).census for k in numbers]
    return campaign.measured_at(string).census(censuses)


def with_values(emulated, values):
    """Return the emulator of all data with other measured values, (Q,)."""
    other = copy.copy(emulated)
    other.__dict__.pop("_nearest", None)  # of other data
    rows = emulated.frame.rows
    pairs = zip(emulated.data, rows, strict=True)
    other.data = tuple(replace(datum, values=values[some]) for datum, some in pairs)
    other.frame = copy.copy(emulated.frame)
    other.frame.measured = values
    other.measured = other.numbers_of(values)
    other.left_out_measured = (values @ emulated.frame.basis - emulated.centre) @ emulated.left_out
    return other


def measured_anew(emulated, values, random, counted=None):
    """Return other measured values of true ones, (Q,), with their errors; sizes are `counted`."""
    made = []
    for datum, rows in zip(emulated.data, emulated.frame.rows, strict=True):
        if datum.quantity == "sizes":
            shares = np.maximum(values[rows], 0.0)
            made.append(random.multinomial(counted, shares / shares.sum()) / counted)
        else:
            made.append(random.normal(values[rows], np.sqrt(np.diag(datum.covariance))))
    return np.concatenate(made)


def drawn_posterior(emulated):
    """Return the strings of a posterior without its check."""
    prior = emulated.box.even_strings(PRIOR_POINTS)
    near = emulated.near(prior)
    return sample_posterior(emulated, near, emulated.log_density(near), len(prior))


def level_of(emulated, drawn, string):
    """Return the weight of denser strings: below 0.9 where a string is in the 90 % region."""
    own = emulated.log_density(np.atleast_2d(string))[0]
    return float(drawn.weights @ (emulated.log_density(drawn.strings) > own))


def with_measurement(posterior, each):
    """Return the emulator of all data of a posterior with a further one, whose value is to come."""
    datum = each.datum
    if not each.repeats:
        covariance = np.array([[each.standard_error**2]])
        datum = replace(datum, values=np.array([each.predicted]), covariance=covariance)
    stored, data = stored_samples(posterior.file), [*posterior.of.data, datum]
    values = string_values(posterior.file, data, stored)
    return EmulatedData(posterior.of.box, data, values, stored)


def volume_after(emulated, true_value, random):
    """Return the volume of the posterior with a value of the last datum, of a true one, (q,)."""
    errors = np.sqrt(np.diag(emulated.data[-1].covariance))
    values = emulated.frame.measured.copy()
    values[emulated.frame.rows[-1]] = random.normal(true_value, errors)
    return drawn_posterior(with_values(emulated, values)).volume


class SimulatedGrid:
    """Strings along the principal axes of a posterior, simulated anew.

    Where they leave the box there are none.
    """

    def __init__(self, emulated, drawn, samples):
        box = emulated.box
        places, shape = box.space.to_unit(drawn.strings), GRID[: len(box.names)]
        centre = drawn.weights @ places
        spread, axes = np.linalg.eigh(np.cov(places.T, aweights=drawn.weights))
        axes, lengths = axes[:, ::-1], np.sqrt(spread[::-1])
        scaled = (places - centre) @ axes / lengths
        ends = [np.linspace(-REACH, REACH, n) for n in shape]
        grid = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, len(shape))
        units = centre + grid * lengths @ axes.T
        inside = ((units >= 0.0) & (units <= 1.0)).all(axis=1)
        self.emulated, self.grid = emulated, grid[inside]
        basis, means, noise = emulated.frame.basis, [], 0.0
        strings = box.space.from_unit(units[inside])
        for string in strings:
            values = predicted(box.campaign, string, emulated.data, samples) @ basis
            means.append(values.mean(axis=0))
            noise = noise + np.cov(values.T) / samples / len(strings)
        self.means, self.noise = np.array(means), np.atleast_2d(noise)
        near = np.abs(scaled).max(axis=1) < REACH
        weights = drawn.weights[near]
        self.outside = 1.0 - weights.sum()
        self.places, self.scaled, self.weights = places[near], scaled[near], weights / weights.sum()

    def compared(self, degree):
        """Return how far strings are from a polynomial of a degree, and KS distances.

        The former in units of their noise, for each column of the frame, about 1 if the degree
        suffices. The latter between each marginal of the posterior and that of the polynomial.
        """
        terms, at = polynomial(self.grid, degree), polynomial(self.scaled, degree)
        fitted = np.linalg.lstsq(terms, self.means, rcond=None)[0]
        away, free = self.means - terms @ fitted, len(terms) - terms.shape[1]
        excess = (away**2).sum(axis=0) / free / np.diag(self.noise)
        frame = self.emulated.frame
        residuals = frame.measured @ frame.basis - at @ fitted
        logarithms = -0.5 * (residuals**2).sum(axis=1)
        simulated = np.exp(logarithms - logarithms.max())
        simulated /= simulated.sum()
        distances = []
        for along in self.places.T:
            order = np.argsort(along)
            apart = np.cumsum(self.weights[order]) - np.cumsum(simulated[order])
            distances.append(float(np.abs(apart).max()))
        return excess, distances


def polynomial(places, degree):
    """Return the terms of a polynomial at places, (n, d), shape (n, terms)."""
    terms = [np.ones(len(places))]
    for power in range(1, degree + 1):
        for chosen in itertools.combinations_with_replacement(range(places.shape[1]), power):
            terms.append(np.prod(places[:, chosen], axis=1))
    return np.column_stack(terms)
