"""Properties of laws of a single grain: cooling between impacts, and fragmentation."""

import math
from typing import Any

import numpy as np

from agglom_mpi.contracts.cases import Violation, equal, within
from agglom_mpi.contracts.formulas import RESULT_ROUNDING
from agglom_mpi.contracts.subject import Case

FEW, MANY = (np.polynomial.legendre.leggauss(count) for count in (12, 24))
"""Nodes and weights on [-1, 1] of two quadratures, whose difference is the error of the first."""


def stays_between(case: Case) -> Violation:
    """Check that a grain stays above 0 K, and between its temperature and where it tends to."""
    start, *grain = case.grain
    rest = case.call("rest_temperature")
    end = case.call("exact_temperature", start, *grain, case["time"])
    margin = RESULT_ROUNDING * max(start, rest)
    low, high = sorted((start, rest))
    if low <= end <= start:  # it may have been at rest before
        return None
    what = f"{start:.9g} K on the way to {rest:.9g} K"
    return within(what, end, max(low - margin, 0.0), high + margin)


def two_intervals_are_one(case: Case) -> Violation:
    """Check that a grain that cools for two times has cooled for their sum."""
    start, *grain = case.grain
    first = case["time"] * case["time_share"]
    middle = case.call("exact_temperature", start, *grain, first)
    twice = case.call("exact_temperature", middle, *grain, case["time"] - first)
    once = case.call("exact_temperature", start, *grain, case["time"])
    margin = RESULT_ROUNDING * max(once, twice, 0.01 * start)
    return equal("the temperature after two intervals in K", twice, once, margin)


def solves_its_equation(case: Case) -> Violation:
    """Check that `exact_temperature` falls by the integral of `cooling_rate` along itself."""
    start, *grain = case.grain
    distance = abs(start - case.call("rest_temperature"))
    first = abs(case.call("cooling_rate", start, *grain))
    if first == 0.0 or distance <= 1e-6 * start:
        return None
    time = case["relaxed"] * distance / first

    def at(share: float) -> float:
        return float(case.call("exact_temperature", start, *grain, share * time))

    def fallen(nodes: Any, weights: Any) -> float:
        temperatures = [at(0.5 * (1.0 + node)) for node in nodes.tolist()]
        rates = [case.call("cooling_rate", each, *grain) for each in temperatures]
        return 0.5 * time * float(weights @ rates)

    coarse, fine = fallen(*FEW), fallen(*MANY)
    margin = 10.0 * abs(fine - coarse) + 1e-9 * abs(fine) + RESULT_ROUNDING * max(start, distance)
    return equal("the fall of the temperature in K", start - at(1.0), fine, margin)


def released(case: Case) -> tuple[float, float, float, int]:
    """Return the loss of a pair and the own change of energy in J, and an aggregate."""
    own = case["own_share"] * case["pair_loss"] + case["work_of_frame"]
    return case["pair_loss"], own, case["radius"], int(case["grains"])


def counts_are_whole(case: Case) -> Violation:
    """Check that there are 1 to `grains` whole pieces, and that a single one takes no energy."""
    pieces, energy = case.call("breakage", *released(case))
    if pieces != int(pieces) or not 1 <= pieces <= case["grains"]:
        return f"the number of pieces of {int(case['grains'])} is {pieces}"
    if energy < 0.0 or (pieces == 1 and energy != 0.0):
        return f"{pieces} pieces take {energy:.9g} J"
    return None


def takes_what_is_there(case: Case) -> Violation:
    """Check that new surface of both grains takes no more energy than the pair has lost."""
    loss, own, radius, grains = released(case)
    taken = case.call("breakage", loss, own, radius, grains).energy
    taken += case.call("breakage", loss, loss - own, radius, grains).energy
    most = loss * (1.0 + RESULT_ROUNDING)
    return within("the energy of new surface in J", taken, -math.inf, most)


def same_pieces_in_other_frame(case: Case) -> Violation:
    """Check that the pieces do not depend on the work of the impulses in another frame."""
    one = case.call("breakage", *released(case))
    other = case.call("breakage", *released(case.but(work_of_frame=0.0)))
    margin, energy = RESULT_ROUNDING * one.energy, "the energy in another frame in J"
    pieces = equal("the number of pieces in another frame", other.pieces, one.pieces, 0)
    return pieces or equal(energy, other.energy, one.energy, margin)
