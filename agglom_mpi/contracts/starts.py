"""Properties of laws of the start: velocities and sizes of the grains, by many random ones."""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.contracts.cases import Violation, equal, factor
from agglom_mpi.contracts.formulas import RESULT_ROUNDING
from agglom_mpi.contracts.subject import Case
from agglom_mpi.physics.size_distributions import SizeDistribution
from agglom_mpi.physics.sizes import Sizes

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
