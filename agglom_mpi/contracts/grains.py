"""Properties of laws of a single grain, and of the start: velocities and sizes, by many of them."""

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.contracts.cases import RESULT_ROUNDING, Violation, equal, factor, within
from agglom_mpi.contracts.subject import Case
from agglom_mpi.physics.size_distributions import SizeDistribution
from agglom_mpi.physics.sizes import Sizes

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


Floats = NDArray[np.float64]

DRAWN_SIZES: Final = 20_000
"""Number of grains whose sizes are drawn."""
DRAWN_VELOCITIES: Final = 1_000
"""Number of grains whose velocities are drawn, one by one."""
DEVIATION: Final = 4.0
"""Maximum difference of a mean over these grains, in standard errors; 1 of 16 000 exceeds it."""
COMPARED_GRAINS: Final = 300
"""Number of grains whose pairs are all compared."""

HIGHEST_MOMENT: Final = 4
QUANTILE_SHARES: Final = (0.1, 0.25, 0.5, 0.75, 0.9)


def drawn_velocities(case: Case, count: int) -> Floats:
    """Return random velocities in m/s, shape (3, count)."""
    velocity = np.full((3, count), np.nan)
    case.call("draw_velocities", np.random.default_rng(int(case["seed"])), velocity)
    return velocity


def velocities_are_finite(case: Case) -> Violation:
    """Check that every component of every velocity is drawn, and finite."""
    velocity = drawn_velocities(case, 100)
    bad = int((~np.isfinite(velocity)).sum())
    return f"{bad} of {velocity.size} components are not finite" if bad else None


def velocities_have_their_variance(case: Case) -> Violation:
    """Check that `variance` is the mean square of the velocities about their mean."""
    velocity = drawn_velocities(case, DRAWN_VELOCITIES)
    squares = ((velocity - velocity.mean(axis=1, keepdims=True)) ** 2).sum(axis=0)
    stated = case.law.variance(case["relative_speed"])
    margin = DEVIATION * float(squares.std()) / math.sqrt(DRAWN_VELOCITIES)
    margin += RESULT_ROUNDING * stated
    return equal("the variance in m2/s2", float(squares.mean()), stated, margin)


def velocities_are_within_bounds(case: Case) -> Violation:
    """Check that `fastest_approach` and `transverse_speed` bound the velocities."""
    velocity, speed = drawn_velocities(case, DRAWN_VELOCITIES), case["relative_speed"]
    some, rounding = velocity[:, :COMPARED_GRAINS], 1e-12 * float(np.abs(velocity).max())
    apart = some[:, :, None] - some[:, None, :]
    fastest, stated = float(np.sqrt((apart**2).sum(axis=0)).max()), case.law.fastest_approach(speed)
    if fastest > stated * (1.0 + RESULT_ROUNDING) + rounding:
        return f"two grains approach at {fastest:.9g} m/s, but at most {stated:.9g} is stated"
    across = velocity[1:] - velocity[1:].mean(axis=1, keepdims=True)
    margin = DEVIATION * float(across.std()) / math.sqrt(DRAWN_VELOCITIES) + rounding
    most, stated = float(np.abs(across).max()), case.law.transverse_speed(speed)
    if most > stated + margin:
        return f"a speed across is {most:.9g} m/s, but {stated:.9g} is stated"
    return None


def flow_does_not_scale(case: Case) -> Violation:
    """Check that `mean_flow` is the part of the velocities that the speed does not scale."""
    once = drawn_velocities(case, 100)
    faster = drawn_velocities(case.but(relative_speed=2.0 * case["relative_speed"]), 100)
    found = float(np.linalg.norm((2.0 * once - faster).mean(axis=1)))
    margin = RESULT_ROUNDING * (float(np.abs(once).max()) + case.law.mean_flow)
    return equal("the flow that all grains share in m/s", found, case.law.mean_flow, margin)


def velocities_in_other_units(case: Case) -> Violation:
    """Check that the same random numbers give the same velocities in other units."""
    velocity, found = drawn_velocities(case, 100), case.in_other_units()
    if found is None:
        return None
    scaled, logarithms = found
    other = drawn_velocities(scaled, 100) / factor("m/s", logarithms)
    away, margin = np.abs(velocity - other).max(), RESULT_ROUNDING * np.abs(velocity).max()
    return equal("a difference in other units in m/s", float(away), 0.0, float(margin))


SIZE_PROPERTIES: Final = ("positive", "moments", "quantiles", "classes")


def sizes_failures(sizes: Sizes, seed: int) -> Iterator[tuple[str, str]]:
    """Yield each property of a law of sizes that does not hold, and what is wrong.

    Radii are positive and finite, their moments and quantiles are those that the law states, and
    its size classes have the mean 1.
    """
    mean, law = sizes.mean_diameter, sizes.size_law
    if mean is not None and not 0.0 < mean < math.inf:
        yield "positive", f"the mean diameter is {mean} m"
    if law is None:
        return
    radii = law.draw(np.random.default_rng(seed), DRAWN_SIZES)
    if radii.shape != (DRAWN_SIZES,) or not (np.isfinite(radii).all() and radii.min() > 0.0):
        yield "positive", f"{DRAWN_SIZES} radii have the shape {radii.shape}, or are not positive"
        return
    yield from _wrong_moments(law, radii)
    yield from _wrong_quantiles(law, radii)
    classes, shares = law.classes
    if not (classes.min() > 0.0 and abs(shares.sum() - 1.0) <= 1e-9 and shares.min() >= 0.0):
        yield "classes", f"shares add up to {shares.sum():.9g}, the least radius is {classes.min()}"


def _wrong_moments(law: SizeDistribution, radii: Floats) -> Iterator[tuple[str, str]]:
    """Yield moments that the drawn radii do not have, by standard errors from the law's own."""
    for power in range(1, HIGHEST_MOMENT + 1):
        stated, values = law.moment(power), radii**power
        spread = max(law.moment(2 * power) - stated**2, float(values.var()))
        margin = DEVIATION * math.sqrt(spread / DRAWN_SIZES) + RESULT_ROUNDING * abs(stated)
        if text := equal(f"moment {power}", float(values.mean()), stated, margin):
            yield "moments", text
    if text := equal("moment 1 of radii over their mean", law.moment(1), 1.0, 1e-9):
        yield "moments", text


def _wrong_quantiles(law: SizeDistribution, radii: Floats) -> Iterator[tuple[str, str]]:
    """Yield quantiles by number below which another share of the drawn radii lies."""
    for share in QUANTILE_SHARES:
        radius = law.quantile(share)
        margin = DEVIATION * math.sqrt(share * (1.0 - share) / DRAWN_SIZES)
        up_to = float((radii <= radius * (1.0 + RESULT_ROUNDING)).mean())
        below = float((radii < radius * (1.0 - RESULT_ROUNDING)).mean())
        if up_to < share - margin or below > share + margin:
            text = f"{below:.4f} to {up_to:.4f} of the radii lie below the quantile {share:g}"
            yield "quantiles", text
