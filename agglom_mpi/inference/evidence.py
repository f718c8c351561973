"""Evidence of data for a campaign: their density, averaged over its search box.

Z = ∫ p(y|θ) π(θ) dθ, with π uniform over the allowed part of the box in the coordinates of the
search. The density p(y|θ) has the errors of the measurement and of the emulator: with the latter, Z
is its own mean over all functions that the samples allow. It is that of the data in units of
their errors, in all directions in which residuals lie: the same for all campaigns of these data.

Z is found by importance sampling. The proposal is a mixture: normal kernels around strings of the
posterior, and a part of even weight over the box, which bounds the weights (Hesterberg,
Technometrics 37, 1995, 185).
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.spatial.distance import cdist

from agglom_mpi.inference.data_emulator import EmulatedData
from agglom_mpi.inference.posterior_sampling import (
    MIN_SIZE,
    PRIOR_POINTS,
    SUFFICIENT_SIZE,
    WeightedStrings,
    effective_size,
    log_density_within,
)
from agglom_mpi.inference.set_directions import touched_ends
from agglom_mpi.statistics import Floats

KERNELS: Final = 256
"""Number of strings of the posterior that have a kernel."""
EVEN_SHARE: Final = 0.2
"""Share of the proposals that are even over the box."""
FIRST_PROPOSALS, MAX_PROPOSALS = 1 << 13, 1 << 16
"""Number of proposals to begin with, and at which no more are drawn."""
MIN_RELATIVE_SPREAD: Final = 1e-12
"""Minimum variance of the kernels along an axis, relative to the largest."""
EVIDENCE_STREAM: Final = 5
"""Random stream of an emulated box."""


class Evidence(NamedTuple):
    """Evidence of data for a campaign.

    Attributes
    ----------
    logarithm, error
        Natural logarithm, of the density of the data in units of their errors, and its standard
        error by the proposals.
    effective_size
        Effective number of proposals.
    inside
        Searched variables that the posterior keeps away from both ends of.
    open_ended
        The others: what lies beyond their ends is not known.
    """

    logarithm: float
    error: float
    effective_size: float
    inside: tuple[str, ...]
    open_ended: tuple[str, ...]

    @property
    def box_doubled(self) -> float:
        """Change of the logarithm if the ranges of all variables were doubled, as far as known.

        Each variable that is inside halves the density of the prior and adds nothing: −ln 2. For
        the others it is between −ln 2 and what strings beyond their ends add; they are left out.
        """
        return -math.log(2.0) * len(self.inside)

    @property
    def is_resolved(self) -> bool:
        """Whether the effective size suffices for the error to be trusted."""
        return self.effective_size >= MIN_SIZE

    def as_dict(self) -> dict[str, Any]:
        """Return the evidence as plain values."""
        return {
            "log_evidence": self.logarithm,
            "log_evidence_error": self.error,
            "effective_size": self.effective_size,
            "log_evidence_change_if_box_doubled": self.box_doubled,
            "variables_inside": list(self.inside),
            "variables_open_ended": list(self.open_ended),
        }


class Proposal:
    """Mixture of normal kernels around strings of the posterior and of even points of the box.

    Parameters
    ----------
    places, weights
        The posterior, in units of the box, shape (n, d), with weights, (n,), whose sum is 1.
    random
        Stream of the kernels' centres.
    """

    def __init__(self, places: Floats, weights: Floats, random: np.random.Generator) -> None:
        d = places.shape[1]
        self._centres = places[random.choice(len(places), KERNELS, p=weights)]
        narrower = (4.0 / ((d + 2.0) * KERNELS)) ** (2.0 / (d + 4.0))  # Silverman 1986, 4.14
        covariance = narrower * np.atleast_2d(np.cov(places.T, aweights=weights))
        variances, axes = np.linalg.eigh(covariance)
        self._scales = np.sqrt(np.maximum(variances, MIN_RELATIVE_SPREAD * variances[-1]))
        self._axes = axes

    def draw(self, count: int, random: np.random.Generator) -> Floats:
        """Draw places, shape (count, d); some are outside of the box."""
        d = self._centres.shape[1]
        even = round(EVEN_SHARE * count)
        which = np.arange(count - even) % KERNELS
        away = random.normal(size=(count - even, d)) * self._scales
        return np.concatenate(
            (random.random((even, d)), self._centres[which] + away @ self._axes.T)
        )

    def density(self, places: Floats) -> Floats:
        """Return the density of places of the box, (n, d), shape (n,)."""
        scaled = (places @ self._axes / self._scales, self._centres @ self._axes / self._scales)
        norm = (2.0 * math.pi) ** (0.5 * places.shape[1]) * np.prod(self._scales)
        kernels = np.exp(-0.5 * cdist(*scaled, "sqeuclidean")).mean(axis=1) / norm
        return np.asarray(EVEN_SHARE + (1.0 - EVEN_SHARE) * kernels)


def evidence_of(of: EmulatedData, drawn: WeightedStrings) -> Evidence:
    """Return the evidence of the data of an emulator.

    Parameters
    ----------
    of
        The data and what strings predict for them.
    drawn
        The posterior; strings are proposed near its draws.
    """
    space, random = of.box.space, of.stream(EVIDENCE_STREAM)
    places = space.to_unit(drawn.strings)
    proposal, count = Proposal(places, drawn.weights, random), FIRST_PROPOSALS
    values, weights = np.empty(0), np.empty(0)
    while True:
        proposed = proposal.draw(count, random)
        some = log_density_within(of, proposed) - np.log(proposal.density(proposed))
        values = np.append(values, some)
        weights = np.exp(values - values.max())
        size = effective_size(weights)
        if size >= SUFFICIENT_SIZE or len(values) >= MAX_PROPOSALS:
            break
        count = len(values)
    allowed = len(of.box.allowed_even_strings(PRIOR_POINTS)) / PRIOR_POINTS
    rare = max(allowed, 1.0 / PRIOR_POINTS)
    relative = math.hypot(
        float(weights.std(ddof=1) / weights.mean()) / math.sqrt(len(weights)),
        math.sqrt((1.0 - rare) / (rare * PRIOR_POINTS)),
    )
    logarithm = float(values.max()) + math.log(float(weights.mean()) / rare) + _constant(of)
    inside, open_ended = list[str](), list[str]()
    for name, mine in zip(of.box.names, places.T, strict=True):
        (open_ended if touched_ends(mine, drawn.weights) else inside).append(name)
    return Evidence(logarithm, relative, size, tuple(inside), tuple(open_ended))


def _constant(of: EmulatedData) -> float:
    """Return what `log_density` leaves out: of all directions, and of those not emulated."""
    count = len(of.left_out_measured) - len(of.exact_columns)
    variance = 1.0 + of.left_out_variance[:count]
    squares = of.left_out_measured[:count] ** 2 / variance
    rank = len(of.centre)
    return float(-0.5 * (rank * math.log(2.0 * math.pi) + np.sum(np.log(variance) + squares)))
