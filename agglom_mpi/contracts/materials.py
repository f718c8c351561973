"""Properties of laws of a material: hardness, and the root of the impact equation."""

import math
from typing import Any, Final

from agglom_mpi.contracts.formula_properties import LawFormula
from agglom_mpi.contracts.kinds import LawKind, LawProperty
from agglom_mpi.contracts.points import Domain, Interval, Point, Violation
from agglom_mpi.contracts.subject import PAIR_DOMAIN, Subject, pair_at
from agglom_mpi.physics.impact_solvers import LARGEST_RESIDUAL, restitution_residual
from agglom_mpi.physics.restitution import ImpactLaws, log_pressure_ratio, log_pressure_scale
from agglom_mpi.physics.restitution import solve_restitution as solve_with

TEMPERATURES: Final[Domain] = {
    "temperature_of_grain": Interval(1.0, 5e3, "K", special=(300.0,)),
    "warmer_by": Interval(1e-3, 10.0),
}
"""Temperature of a grain in K, and how much warmer another one is relative to it."""

LEAST_CHANGE: Final = 1e-5
"""Least change of ln H that is compared with its derivative: rounding is 1e-16 of ln H itself."""

SCANNED: Final = 240
"""Number of deficits in the scan for a missed root."""
LOWEST_LOG_DEFICIT: Final = -24.0
"""ln d of the smallest of these deficits."""

MOST_LOG: Final = 300.0
"""Maximum change of ln H0."""

ROOTS: Final = 600
"""Number of pairs for which the impact equation is scanned."""

ROOT_DOMAIN: Final[Domain] = {
    **{name: interval for name, interval in PAIR_DOMAIN.items() if name != "approach_speed"},
    "heat_ratio": Interval(1e-1, 1e2),
    "pressure_ratio": Interval(0.3, 0.999),
}
"""A pair whose impact softens it, and nearly bonds it: kinetic energy of the approach over heat,
w²/(Cθ), and pressure with e = 0 over twice the hardness after it. One in thirty has several roots.
"""


def _temperature(subject: Subject, point: Point) -> tuple[Any, ...]:
    return (point["temperature_of_grain"],)


def _cold_and_warm(point: Point) -> tuple[float, float]:
    """Return two temperatures of a grain in K, the lower one first."""
    cold = point["temperature_of_grain"]
    return cold, cold * (1.0 + point["warmer_by"])


def hardness_falls(subject: Subject, point: Point) -> Violation:
    """Check that hardness never rises with the temperature."""
    numbers = subject.numbers(point)
    hardening = subject.formula("log_hardening")
    cold, warm = _cold_and_warm(point)
    first, second = hardening(numbers, cold), hardening(numbers, warm)
    if second <= first + 1e-12 * abs(first):
        return None
    return f"ln(H/H0) rises from {first:.9g} at {cold:.6g} K to {second:.9g} at {warm:.6g} K"


def softening_is_derivative(subject: Subject, point: Point) -> Violation:
    """Check that `softening_rate` is -d ln H/dtheta, by the mean slope between two ends."""
    numbers = subject.numbers(point)
    hardening, rate = (subject.formula(name) for name in ("log_hardening", "softening_rate"))
    cold, warm = _cold_and_warm(point)
    first, second = hardening(numbers, cold), hardening(numbers, warm)
    if not (math.isfinite(first) and abs(first - second) >= LEAST_CHANGE * max(1.0, abs(first))):
        return _without_change(numbers, rate, (cold, warm), first, second)
    mean = (first - second) / (warm - cold)
    ends = sorted((rate(numbers, cold), rate(numbers, warm)))
    margin = 1e-9 * mean  # 1e-16 of ln H over its least change
    if ends[0] - margin <= mean <= ends[1] + margin:
        return None
    return (
        f"ln H falls by {mean:.9g}/K from {cold:.6g} to {warm:.6g} K, but softening_rate is "
        f"{rate(numbers, cold):.9g}/K and {rate(numbers, warm):.9g}/K there"
    )


def _without_change(
    numbers: Any, rate: Any, temperatures: tuple[float, float], first: float, second: float
) -> Violation:
    """Return what is wrong with rates where ln H does not change."""
    found = [rate(numbers, temperature) for temperature in temperatures]
    if first == second and math.isfinite(first) and min(found) > 0.0:
        return f"ln H does not change, but softening_rate is {min(found):.9g}/K"
    return None


def softening_never_rises(subject: Subject, point: Point) -> Violation:
    """Check that `softening_rate` is not negative and never rises, as the root finder assumes."""
    numbers = subject.numbers(point)
    rate = subject.formula("softening_rate")
    cold, warm = _cold_and_warm(point)
    first, second = rate(numbers, cold), rate(numbers, warm)
    if 0.0 <= second <= first * (1.0 + 1e-12):
        return None
    return (
        f"softening_rate is {first:.9g}/K at {cold:.6g} K and {second:.9g}/K at {warm:.6g} K; it "
        "must not rise"
    )


def root_is_the_smallest(subject: Subject, point: Point) -> Violation:
    """Check that a dense scan finds no smaller root of e = G(e) than the solver."""
    laws = subject.impact_laws(point)
    if laws.solver is None:
        return None
    heat = point["heat_capacity"] * point["temperature_i"]
    pair = pair_at({**point, "approach_speed": math.sqrt(point["heat_ratio"] * heat)})
    laws = _with_pressure_ratio(laws, pair, point["pressure_ratio"])
    solution = solve_with(laws.restitution, laws, pair)
    scale = log_pressure_scale(laws, pair)
    if solution.bonds or log_pressure_ratio(laws, pair, scale, 1.0) >= 0.0:
        return None
    residual = restitution_residual(laws, pair, scale, solution.deficit)
    if residual > LARGEST_RESIDUAL and solution.deficit > 0.0:
        return f"|e - G(e)| is {residual:.3g} at e = {1.0 - solution.deficit:.9g}"
    found = math.log(solution.deficit) if solution.deficit > 0.0 else -math.inf
    for step in range(1, SCANNED + 1):
        place = LOWEST_LOG_DEFICIT * step / SCANNED
        if place <= found + 1e-9:  # the root itself, by its tolerance and the slope of ln r
            return None
        if log_pressure_ratio(laws, pair, scale, math.exp(place)) >= place:
            return (
                f"e = {1.0 - solution.deficit:.9g} was found, but there is a root below "
                f"e = {-math.expm1(place):.9g}"
            )
    return None


def _with_pressure_ratio(laws: ImpactLaws, pair: Any, ratio: float) -> ImpactLaws:
    """Return laws with H0 chosen so that a pair has the given pressure ratio."""
    excess = log_pressure_ratio(laws, pair, log_pressure_scale(laws, pair), 1.0) - math.log(ratio)
    if "hardness" not in laws.hardness._fields or not abs(excess) < MOST_LOG:
        return laws
    hardness = laws.hardness.hardness * math.exp(excess)
    return laws._replace(hardness=laws.hardness._replace(hardness=hardness))


ROOT_PROPERTY: Final = LawProperty("root", root_is_the_smallest, ROOT_DOMAIN, ROOTS)
"""Property of all laws that the impact equation is made of, where a scene solves it."""

HARDNESS_KIND: Final = LawKind(
    formulas=(
        LawFormula("log_hardening", _temperature, ("1",), TEMPERATURES, may_be_infinite=True),
        LawFormula("softening_rate", _temperature, ("1/K",), TEMPERATURES),
    ),
    properties=(
        LawProperty("falls", hardness_falls, TEMPERATURES),
        LawProperty("derivative", softening_is_derivative, TEMPERATURES),
        LawProperty("convex", softening_never_rises, TEMPERATURES),
    ),
)
