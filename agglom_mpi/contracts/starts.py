"""Properties of laws of the start: velocities and sizes of the grains, by many random ones."""

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.contracts.formula_properties import RESULT_ROUNDING
from agglom_mpi.contracts.kinds import LawKind, LawProperty
from agglom_mpi.contracts.other_units import UNIT_DOMAIN, factor, other_units, scaled_point
from agglom_mpi.contracts.points import Domain, Interval, Point, Violation
from agglom_mpi.contracts.subject import Subject
from agglom_mpi.physics.size_distributions import SizeDistribution
from agglom_mpi.physics.sizes import Sizes

Floats = NDArray[np.float64]

DRAWN_SIZES: Final = 20_000
"""Number of grains whose sizes are drawn."""
DRAWN_VELOCITIES: Final = 4_000
"""Number of grains whose velocities are drawn, one by one."""
DEVIATION: Final = 4.0
"""Maximum difference of a mean over these grains, in standard errors; 1 of 16 000 exceeds it."""
POINTS_OF_MANY_GRAINS: Final = 3
"""Number of points at which `DRAWN_VELOCITIES` grains are drawn."""
COMPARED_GRAINS: Final = 300
"""Number of grains whose pairs are all compared."""

SEEDS: Final[Domain] = {"seed": Interval(1.0, 1e6, whole=True)}
HIGHEST_MOMENT: Final = 4
QUANTILE_SHARES: Final = (0.1, 0.25, 0.5, 0.75, 0.9)


def drawn_velocities(subject: Subject, point: Point, count: int) -> Floats:
    """Return random velocities in m/s, shape (3, count)."""
    velocity = np.full((3, count), np.nan)
    random = np.random.default_rng(int(point["seed"]))
    subject.formula("draw_velocities")(subject.numbers(point), random, velocity)
    return velocity


def velocities_are_finite(subject: Subject, point: Point) -> Violation:
    """Check that every component of every velocity is drawn, and finite."""
    velocity = drawn_velocities(subject, point, 100)
    bad = int((~np.isfinite(velocity)).sum())
    return f"{bad} of {velocity.size} components are not finite" if bad else None


def velocities_have_their_variance(subject: Subject, point: Point) -> Violation:
    """Check that `variance` is the mean square of the velocities about their mean."""
    velocity = drawn_velocities(subject, point, DRAWN_VELOCITIES)
    squares = ((velocity - velocity.mean(axis=1, keepdims=True)) ** 2).sum(axis=0)
    found, error = float(squares.mean()), float(squares.std()) / math.sqrt(DRAWN_VELOCITIES)
    law: Any = subject.law_at(point)
    stated = law.variance(point["relative_speed"])
    if abs(found - stated) <= DEVIATION * error + RESULT_ROUNDING * stated:
        return None
    return f"the variance is {found:.6g} +- {error:.2g} m2/s2, but {stated:.6g} is stated"


def velocities_are_within_bounds(subject: Subject, point: Point) -> Violation:
    """Check that `fastest_approach` and `transverse_speed` bound the velocities."""
    velocity = drawn_velocities(subject, point, DRAWN_VELOCITIES)
    law: Any = subject.law_at(point)
    speed = point["relative_speed"]
    some = velocity[:, :COMPARED_GRAINS]
    apart = some[:, :, None] - some[:, None, :]
    fastest = float(np.sqrt((apart**2).sum(axis=0)).max())
    size = float(np.abs(velocity).max())
    if fastest > law.fastest_approach(speed) * (1.0 + RESULT_ROUNDING) + 1e-12 * size:
        stated = law.fastest_approach(speed)
        return f"two grains approach at {fastest:.9g} m/s, but at most {stated:.9g} is stated"
    across = velocity[1:] - velocity[1:].mean(axis=1, keepdims=True)
    margin = DEVIATION * float(across.std()) / math.sqrt(DRAWN_VELOCITIES) + 1e-12 * size
    if float(np.abs(across).max()) > law.transverse_speed(speed) + margin:
        stated = law.transverse_speed(speed)
        return f"a speed across is {np.abs(across).max():.9g} m/s, but {stated:.9g} is stated"
    return None


def flow_does_not_scale(subject: Subject, point: Point) -> Violation:
    """Check that `mean_flow` is the part of the velocities that the speed does not scale."""
    once = drawn_velocities(subject, point, 100)
    faster = {**point, "relative_speed": 2.0 * point["relative_speed"]}
    flow = (2.0 * once - drawn_velocities(subject, faster, 100)).mean(axis=1)
    law: Any = subject.law_at(point)
    found, stated = float(np.sqrt((flow**2).sum())), float(law.mean_flow)
    if (
        abs(found - stated)
        <= RESULT_ROUNDING * float(np.abs(once).max()) + RESULT_ROUNDING * stated
    ):
        return None
    return f"the flow that all grains share is {found:.9g} m/s, but {stated:.9g} is stated"


def velocities_in_other_units(subject: Subject, point: Point) -> Violation:
    """Check that the same random numbers give the same velocities in other units."""
    logarithms = other_units(point, subject.constants)
    if logarithms is None:
        return None
    scaled = scaled_point(point, subject.domain, logarithms)
    velocity = drawn_velocities(subject, point, 100)
    other = drawn_velocities(subject.in_units(logarithms), scaled, 100) / factor("m/s", logarithms)
    away = float(np.abs(velocity - other).max())
    if away <= RESULT_ROUNDING * float(np.abs(velocity).max()):
        return None
    return f"a velocity differs by {away:.6g} m/s in other units"


VELOCITIES_KIND: Final = LawKind(
    formulas=(),
    properties=(
        LawProperty("finite", velocities_are_finite, SEEDS, 20),
        LawProperty("variance", velocities_have_their_variance, SEEDS, POINTS_OF_MANY_GRAINS),
        LawProperty("bounds", velocities_are_within_bounds, SEEDS, POINTS_OF_MANY_GRAINS),
        LawProperty("flow", flow_does_not_scale, SEEDS, 20),
        LawProperty("units", velocities_in_other_units, {**SEEDS, **UNIT_DOMAIN}, 20),
    ),
)

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
        shown = float(radii.min()) if radii.size else math.nan
        yield (
            "positive",
            f"{DRAWN_SIZES} radii have the shape {radii.shape}, the least is {shown:.6g}",
        )
        return
    yield from (("moments", text) for text in _wrong_moments(law, radii))
    yield from (("quantiles", text) for text in _wrong_quantiles(law, radii))
    classes, shares = law.classes
    if not (classes.min() > 0.0 and abs(shares.sum() - 1.0) <= 1e-9 and shares.min() >= 0.0):
        yield "classes", f"shares add up to {shares.sum():.9g}, the least radius is {classes.min()}"


def _wrong_moments(law: SizeDistribution, radii: Floats) -> Iterator[str]:
    """Yield moments that the drawn radii do not have, by standard errors from the law's own."""
    for power in range(1, HIGHEST_MOMENT + 1):
        stated, found = law.moment(power), float((radii**power).mean())
        spread = max(law.moment(2 * power) - stated**2, 0.0)
        error = math.sqrt(max(spread, float((radii**power).var())) / DRAWN_SIZES)
        if abs(found - stated) > DEVIATION * error + RESULT_ROUNDING * abs(stated):
            yield f"moment {power} is {found:.6g} +- {error:.2g}, but {stated:.6g} is stated"
    if abs(law.moment(1) - 1.0) > 1e-9:
        yield f"moment 1 is stated as {law.moment(1):.9g}; radii are over their mean"


def _wrong_quantiles(law: SizeDistribution, radii: Floats) -> Iterator[str]:
    """Yield quantiles by number below which another share of the drawn radii lies."""
    for share in QUANTILE_SHARES:
        radius = law.quantile(share)
        margin = DEVIATION * math.sqrt(share * (1.0 - share) / DRAWN_SIZES)
        up_to = float((radii <= radius * (1.0 + RESULT_ROUNDING)).mean())
        below = float((radii < radius * (1.0 - RESULT_ROUNDING)).mean())
        if up_to < share - margin or below > share + margin:
            yield f"{below:.4f} to {up_to:.4f} of the radii lie below the quantile {share:g}"
