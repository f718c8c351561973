"""The part of a feasible set that is claimed to be right, and strings drawn evenly from it.

The part has all strings whose probability P to be members is at least a threshold. It is chosen
before any fresh sample, by the emulator alone: the largest part for which the claim would be
shown with a probability of `WANTED_CHANCE`. That probability is averaged over functions drawn
jointly from the emulator, so that it counts that a whole part may be wrong. A right string counts
only if its samples can decide it, so its mean must keep a distance from the bounds.
"""

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple, Self

import numpy as np

from agglom_mpi.config.plan import ENTRY, CertificatePlan
from agglom_mpi.errors import UserError
from agglom_mpi.inference.emulated_set import EmulatedSet
from agglom_mpi.inference.set_points import OUTER_PROBABILITY, SetPoints
from agglom_mpi.random_streams import CERTIFICATE, search_stream
from agglom_mpi.search.criteria import DRAWN_FUNCTIONS, Band, Criterion
from agglom_mpi.search.membership import MembershipTest, chance_to_show, looks_until
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_objective


class CertificateError(UserError, ValueError):
    """There is nothing to certify, or a certificate belongs to something else."""


class PartOfSet(NamedTuple):
    """The part of a set that a certificate is about.

    Attributes
    ----------
    least_probability
        The part is all strings that are members with at least this probability; where values
        wobble, on average over the wobble.
    share
        Its share of what is allowed of the box.
    allowed
        Share of the box that the constraints allow.
    expected
        Probability by the emulator that the claim would be shown.
    least_mean
        Least mean growth of a right string, where members are those near a maximum: the share of
        the emulated maximum. nan otherwise.
    """

    least_probability: float
    share: float
    allowed: float
    expected: float
    least_mean: float = math.nan

    def entries(self) -> dict[str, object]:
        """Return it as entries of an identity, without what is nan."""
        return {ENTRY + n: v for n, v in self._asdict().items() if not math.isnan(v)}

    @classmethod
    def of_entries(cls, identity: Mapping[str, Any]) -> Self:
        """Return the part of an identity."""
        return cls(*(float(identity.get(ENTRY + name, math.nan)) for name in cls._fields))

    def criterion(self, data: CampaignData, tolerance: float) -> Criterion:
        """Return what makes a string of the campaign of a file right."""
        criterion = recorded_objective(data).criterion(tolerance)
        if math.isnan(self.least_mean):
            return criterion
        text = f"mean b/b0 at least {self.least_mean:.4g}, near the emulated maximum"
        return Band("mean_radius_ratio", self.least_mean, math.inf, text)


WANTED_CHANCE: Final = 0.8
"""Minimum probability that the claim is shown; the largest part that has it is chosen."""
LEAST_POINTS: Final = 20
"""Minimum number of points of a part."""

CHOICE_STREAM, DRAW_STREAM, _, SAMPLE_STREAM = range(4)
"""Random streams of a certificate."""


CertifiedPart = tuple[PartOfSet, Floats]
"""A part of a set, and strings of it with their deviations, (n, k) in SI units."""


def certified_part(
    emulated: EmulatedSet, points: SetPoints, plan: CertificatePlan
) -> CertifiedPart:
    """Return the part of a set that a plan can claim, and the strings to test it.

    Parameters
    ----------
    emulated
        The set, with the deviations of the plan.
    points
        Points that measure it.
    plan
        The claim.

    Raises
    ------
    CertificateError
        If there are too few members.
    """
    wobble, probability = emulated.wobble, points.probability
    order = np.argsort(-probability, kind="stable")
    order = order[probability[order] >= OUTER_PROBABILITY]
    name = emulated.box.campaign.name
    if len(order) < LEAST_POINTS:
        raise CertificateError(
            f"{name}: {len(order)} of the {len(probability):,} points that measure the set are "
            f"members with P ≥ {OUTER_PROBABILITY:g}; at least {LEAST_POINTS} are needed"
        )
    random = search_stream(plan.seed, CERTIFICATE, CHOICE_STREAM)
    strings = wobble.drawn(points.strings[order], random)
    chances = _chances(emulated, strings, plan, random)
    ends = np.append(np.diff(probability[order]) < 0.0, True)  # equal points belong together
    chances[~ends | (np.arange(len(order)) < LEAST_POINTS - 1)] = 0.0
    wanted = np.flatnonzero(chances >= WANTED_CHANCE)
    last = int(wanted[-1] if len(wanted) else chances.argmax())
    least = float(probability[order[last]])
    share = float(points.weights[probability >= least].sum())
    criterion = emulated.criterion
    least_mean = criterion.bounds()[0] if criterion.maximum is not None else np.nan
    part = PartOfSet(least, share, points.allowed, float(chances[last]), least_mean)

    def kept(strings: Floats) -> np.ndarray:
        return np.asarray(emulated.probability(strings) >= least)

    random = search_stream(plan.seed, CERTIFICATE, DRAW_STREAM)
    try:
        drawn = points.draw(emulated, plan.strings, random, kept)
    except RuntimeError as error:
        raise CertificateError(f"{name}: {error}") from None
    return part, wobble.drawn(drawn, random)


def _chances(
    emulated: EmulatedSet, strings: Floats, plan: CertificatePlan, random: np.random.Generator
) -> Floats:
    """Return the probability to show the claim for the first 1, 2, … strings, (n,), as the part.

    Parameters
    ----------
    emulated
    strings
        The most probable members first, shape (n, k).
    plan
    random
        Stream of the drawn functions.
    """
    needed = plan.right_needed
    assert needed is not None
    at = emulated.coordinates.of_strings(strings)
    criterion = emulated.criterion
    drawn = emulated.emulator.draw(DRAWN_FUNCTIONS, random)(at)
    margin = _margin(emulated, at, plan)
    right = criterion.holds(drawn - margin) & criterion.holds(drawn + margin)
    alive = 1.0 - emulated.failing(at)
    shares = np.cumsum(right * alive, axis=1) / np.arange(1, len(at) + 1)
    return np.asarray(chance_to_show(needed, plan.strings, shares).mean(axis=0))


def _margin(emulated: EmulatedSet, at: Floats, plan: CertificatePlan) -> Floats:
    """Return how far means at points, (n, c), must be from bounds to be decided, (n, q).

    It is 0 where functions of means are compared, whose errors the emulator does not tell.
    """
    criterion, emulator = emulated.criterion, emulated.emulator
    noise = emulator.noise(at)
    if criterion.compared(noise) is not noise:
        return np.zeros((len(at), len(criterion.bands())))
    test = MembershipTest(criterion, looks_until(plan.max_samples), emulated.extremes)
    return test.margin(plan.max_samples, emulator.mean(at), noise)
