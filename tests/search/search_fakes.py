"""Stand-ins for what surrounds a search: outcomes of samples and a box to search."""

import numpy as np
from decision_log import DecisionLog
from summary_rows import rows_of

from agglom_mpi.outcome import COMPLETED, FAILED, OUTCOME, summaries
from agglom_mpi.search.proposals import Evaluations
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.variables import TEN

PARTICLES = 100


class Decisions(DecisionLog):
    """All that an inversion decides, and what is said of it to the inversion."""

    def __init__(self):
        super().__init__()
        self.batches = []

    def start(self, inversion):
        self.record(inversion.start())

    def complete(self, inversion, string, first, outcomes):
        """Let the inversion have samples of a string, by their summaries."""
        self.record(inversion.complete(string, first, rows_of(outcomes)))

    def text(self):
        """Return every decision, with every bit of every number."""
        with np.printoptions(threshold=10**9, floatmode="unique"):
            return repr((self.batches, sorted(self.results.items()), self.summaries))


def completed(ratio, particles=PARTICLES, moments=(0.0, 0.0, 0.0)):
    """Return the outcome of a sample that ended with so many particles of such radii."""
    record = np.zeros(1, OUTCOME)
    record["state"] = COMPLETED
    record["mean_radius_ratio"] = ratio
    record["particles"] = particles
    for order, moment in zip((2, 3, 4), moments, strict=True):
        record[f"radius_moment_{order}"] = moment
    return summaries(record)[0]


def of_radii(radii):
    """Return the outcome of a sample that ended with these radii b/b⁰."""
    away = radii - np.mean(radii)
    moments = tuple(np.mean(away**order) for order in (2, 3, 4))
    return completed(np.mean(radii), len(radii), moments)


def failed():
    """Return the outcome of a sample that failed."""
    record = np.zeros(1, OUTCOME)
    record["state"] = FAILED
    record["reason"] = 3
    record["mean_radius_ratio"] = np.nan
    return summaries(record)[0]


def papers_box():
    """Return the box of paper A, with the surface energy unused."""
    lower = np.array([0.1, 0.4, 1e3, 1e7, 10, 0.01, 273.13, 10, 0, np.nan])
    upper = np.array([30, 0.8, 1e4, 2e8, 1500, 0.5, 373.13, 1000, 1e7, np.nan])
    return SearchSpace(lower, upper)


def unit_box():
    return SearchSpace(np.zeros(TEN.count), np.ones(TEN.count))


def judged(ids, parameters, objectives, samples=1):
    """Return what a search is told of strings with as many samples each."""
    return Evaluations(ids, parameters, objectives, objectives, np.full(len(ids), samples))
