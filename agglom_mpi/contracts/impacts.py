"""Properties of laws of an impact: restitution, duration, friction, heating, reaction."""

import math
from typing import Any, Final

from agglom_mpi.compilation.kernels import as_plain
from agglom_mpi.contracts.formula_properties import RESULT_ROUNDING, LawFormula
from agglom_mpi.contracts.kinds import LawKind, LawProperty
from agglom_mpi.contracts.points import Domain, Interval, Point, Violation
from agglom_mpi.contracts.subject import PAIR_DOMAIN, Subject, pair_at
from agglom_mpi.physics.friction import friction_loss, normal_loss, tangential_impulse
from agglom_mpi.physics.heating import merge_dissipation
from agglom_mpi.simulation.impact import solve_impact

ENERGY_ROUNDING: Final = 1e-12
"""Relative rounding of an energy: some ten operations of 1.1e-16 each, and a margin."""

EXACT: Final = 4.0 * 2.0**-52
"""Rounding of a number within 0 … 1 that one subtraction gives."""

BOUNCE: Final[Domain] = {**PAIR_DOMAIN, "deficit": Interval(1e-9, 1.0, special=(1.0,))}
"""A pair and a deficit 1 − e."""

DEFICIT_RANGE: Final[Domain] = {
    **PAIR_DOMAIN,
    "upper": Interval(1e-6, 1.0, special=(1.0,)),
    "lower_share": Interval(0.0, 1.0, "1", False),
    "between": Interval(0.0, 1.0, "1", False),
}
"""A pair, and deficits from `lower_share` of `upper` to `upper`."""


def _pair(subject: Subject, point: Point) -> tuple[Any, ...]:
    return (pair_at(point),)


def _bounce(subject: Subject, point: Point) -> tuple[Any, ...]:
    return pair_at(point), point["deficit"]


def _laws_and_pair(subject: Subject, point: Point) -> tuple[Any, ...]:
    return subject.impact_laws(point), pair_at(point)


def _friction_and_bounce(subject: Subject, point: Point) -> tuple[Any, ...]:
    return subject.impact_laws(point).friction, pair_at(point), point["deficit"]


def energy_scale(point: Point) -> float:
    """Return the size of the kinetic energies in J whose differences heats are."""
    pair = pair_at(point)
    frame = abs(point.get("frame_along_n", 0.0)) + abs(point.get("frame_along_t", 0.0))
    components = (pair.normal_i, pair.normal_j, pair.tangent_i, pair.tangent_j)
    speeds = sum(map(abs, components)) + 2.0 * frame
    return max(pair.mass_i, pair.mass_j) * speeds * speeds


def within_limits(subject: Subject, point: Point) -> Violation:
    """Check that restitution is within 0 … 1."""
    numbers, laws = subject.numbers(point), subject.impact_laws(point)
    solution = subject.formula("solve_restitution")(numbers, laws, pair_at(point))
    restitution = 1.0 - solution[0]
    if -EXACT <= restitution <= 1.0 + EXACT:
        return None
    return f"restitution is {restitution:.9g}, not within 0 ... 1"


def makes_no_energy(subject: Subject, point: Point) -> Violation:
    """Check that no impact makes kinetic energy, and that its loss is what is gone."""
    laws = subject.impact_laws(point)
    pair = pair_at({**point, "normal_j": 0.0, "tangent_j": 0.0})
    impact = as_plain(solve_impact)(laws, pair)
    if impact.bonds:
        return None
    before = 0.5 * pair.reduced_mass * (pair.approach_speed**2 + pair.slip_speed**2)
    normal = pair.approach_speed - impact.normal_impulse / pair.reduced_mass
    slip = pair.slip_speed - impact.friction_impulse / pair.reduced_mass
    after = 0.5 * pair.reduced_mass * (normal * normal + slip * slip)
    if after > before * (1.0 + ENERGY_ROUNDING):
        return f"the pair has {after / before:.9g} of its kinetic energy after the impact"
    if abs(before - after - impact.loss) > ENERGY_ROUNDING * before:
        return f"the loss is {impact.loss:.9g} J, but {before - after:.9g} J of motion are gone"
    return None


def never_drives_slip(subject: Subject, point: Point) -> Violation:
    """Check that friction acts against the slip, and at most ends it."""
    numbers = subject.numbers(point)
    pair = pair_at(point)
    impulse = subject.formula("tangential_impulse")(numbers, pair, point["deficit"])
    most = pair.reduced_mass * pair.slip_speed
    if 0.0 <= impulse <= most * (1.0 + ENERGY_ROUNDING):
        return None
    return f"the friction impulse is {impulse:.9g} N s, not within 0 ... m*|u_t| = {most:.9g} N s"


def _deficits(point: Point) -> tuple[float, float, float]:
    """Return the lower, a middle and the upper deficit of a point."""
    upper = point["upper"]
    lower = upper * point["lower_share"]
    return lower, lower + point["between"] * (upper - lower), upper


def slopes_bound_impulse(subject: Subject, point: Point) -> Violation:
    """Check that the slope of the friction impulse with the deficit is within `impulse_slopes`."""
    numbers = subject.numbers(point)
    pair = pair_at(point)
    lower, middle, upper = _deficits(point)
    least, most = subject.formula("impulse_slopes")(numbers, pair, lower, upper)
    formula = subject.formula("tangential_impulse")
    low, mid, high = (formula(numbers, pair, deficit) for deficit in (lower, middle, upper))
    margin = ENERGY_ROUNDING * max(abs(low), abs(mid), abs(high))
    for start, end, change in ((lower, middle, mid - low), (middle, upper, high - mid)):
        width = end - start
        if not least * width - margin <= change <= most * width + margin:
            return (
                f"the impulse changes by {change:.9g} N s over a width of {width:.3g}, but slopes "
                f"from {least:.9g} to {most:.9g} N s are stated"
            )
    return None


def keeps_the_books(subject: Subject, point: Point) -> Violation:
    """Check that both heats are the kinetic energy that the pair loses, also in a merge."""
    numbers, laws = subject.numbers(point), subject.impact_laws(point)
    pair = pair_at(point)
    deficit = point["deficit"]
    margin = ENERGY_ROUNDING * energy_scale(point)
    impulse = tangential_impulse(laws.friction, pair, deficit)
    loss = normal_loss(pair, deficit) + friction_loss(pair, impulse)
    heat = sum(subject.formula("impact_heats")(numbers, laws.friction, pair, deficit))
    if abs(heat - loss) > margin:
        return f"the grains get {heat:.9g} J of heat, but lose {loss:.9g} J of motion"
    merged, lost = subject.formula("merge_heat")(numbers, pair), merge_dissipation(pair)
    if abs(merged - lost) > margin:
        return f"a merge gives {merged:.9g} J of heat, but takes {lost:.9g} J of motion"
    return None


def slopes_bound_heats(subject: Subject, point: Point) -> Violation:
    """Check that each heat is below the line of `least_heat_slopes` through its upper end."""
    numbers, laws = subject.numbers(point), subject.impact_laws(point)
    pair = pair_at(point)
    lower, middle, upper = _deficits(point)
    slopes = subject.formula("least_heat_slopes")(numbers, laws.friction, pair, lower, upper)
    heats = subject.formula("impact_heats")
    ends, inner = (heats(numbers, laws.friction, pair, d) for d in (upper, middle))
    margin = ENERGY_ROUNDING * energy_scale(point)
    for end, within, slope in zip(ends, inner, slopes, strict=True):
        line = end - slope * (upper - middle)
        if within > line + margin:
            return f"a heat is {within:.9g} J at deficit {middle:.6g}; the line gives {line:.9g} J"
    return None


def heat_rises_less_than_deficit(subject: Subject, point: Point) -> Violation:
    """Check that heat over deficit never rises without friction, if `keeps_root_unique`."""
    numbers = subject.numbers(point)
    if not subject.formula("keeps_root_unique")(numbers):
        return None
    pair = pair_at(point)
    _, middle, upper = _deficits(point)
    if middle == 0.0:
        return None
    heats = subject.formula("impact_heats")
    shares = zip(heats(numbers, None, pair, middle), heats(numbers, None, pair, upper), strict=True)
    for low, high in shares:
        if high * middle > low * upper + RESULT_ROUNDING * abs(low) * upper:
            return f"heat over deficit rises from {low / middle:.9g} J to {high / upper:.9g} J"
    return None


def is_proportional_to_area(subject: Subject, point: Point) -> Violation:
    """Check that the heat of reaction is proportional to the area, as the root finder assumes."""
    numbers = subject.numbers(point)
    heat = subject.formula("contact_heat")
    first, second = point["area"], point["area"] * point["area_ratio"]
    whole = heat(numbers, first + second)
    parts = heat(numbers, first) + heat(numbers, second)
    if abs(whole - parts) <= RESULT_ROUNDING * (
        abs(heat(numbers, first)) + abs(heat(numbers, second))
    ):
        return None
    return f"two areas give {parts:.9g} J, and their sum {whole:.9g} J"


def factor_never_falls(subject: Subject, point: Point) -> Violation:
    """Check that `restitution_factor` is positive and never falls with the restitution."""
    numbers = subject.numbers(point)
    factor = subject.formula("restitution_factor")
    _, middle, upper = _deficits(point)
    low, high = factor(numbers, 1.0 - upper), factor(numbers, 1.0 - middle)
    if 0.0 < low <= high * (1.0 + ENERGY_ROUNDING):
        return None
    return f"the factor is {low:.9g} at e = {1.0 - upper:.6g} and {high:.9g} at {1.0 - middle:.6g}"


def factor_slope_is_right(subject: Subject, point: Point) -> Violation:
    """Check that `restitution_factor_slope` is -d ln(factor)/d ln d, and never falls with d."""
    numbers = subject.numbers(point)
    factor, slope = (
        subject.formula(name) for name in ("restitution_factor", "restitution_factor_slope")
    )
    _, middle, upper = _deficits(point)
    if middle < 1e-6 * upper or middle > 0.99 * upper:
        return None
    change = math.log(factor(numbers, 1.0 - middle) / factor(numbers, 1.0 - upper))
    mean = change / math.log(upper / middle)
    least, most = slope(numbers, middle), slope(numbers, upper)
    if least - 1e-9 <= mean <= most + 1e-9:  # a difference of logarithms over at least 0.01
        return None
    return f"the slope is {mean:.9g}, but {least:.9g} and {most:.9g} are stated at the two ends"


def pressure_knows_no_size(subject: Subject, point: Point) -> Violation:
    """Check that the pressure of equal grains is positive, and the same for every radius."""
    numbers = subject.numbers(point)
    pressures = []
    for radius in (point["radius_i"], point["radius_j"]):
        pair = pair_at({**point, "radius_i": radius, "radius_j": radius})
        pressures.append(subject.formula("force_scale")(numbers, pair) / radius**2)
    first, second = pressures
    if first > 0.0 and abs(first - second) <= RESULT_ROUNDING * first:
        return None
    return f"force over radius squared is {first:.9g} Pa and {second:.9g} Pa for two radii"


AREA: Final[Domain] = {
    "area": Interval(1e-12, 1e-2, "m^2"),
    "area_ratio": Interval(1e-3, 1e3),
}

RESTITUTION_KIND: Final = LawKind(
    formulas=(
        LawFormula(
            "solve_restitution",
            _laws_and_pair,
            ("1", "1"),
            PAIR_DOMAIN,
            (0, 1),
            results=lambda solution: (float(solution.deficit), float(solution.bonds)),
        ),
    ),
    properties=(
        LawProperty("range", within_limits, PAIR_DOMAIN),
        LawProperty("energy", makes_no_energy, PAIR_DOMAIN),
    ),
)
FRICTION_KIND: Final = LawKind(
    formulas=(LawFormula("tangential_impulse", _bounce, ("kg*m/s",), BOUNCE, (0,)),),
    properties=(
        LawProperty("slip", never_drives_slip, BOUNCE),
        LawProperty("slopes", slopes_bound_impulse, DEFICIT_RANGE),
    ),
)
HEATING_KIND: Final = LawKind(
    formulas=(
        LawFormula(
            "impact_heats",
            _friction_and_bounce,
            ("J", "J"),
            BOUNCE,
            (1, 0),
            scale=energy_scale,
        ),
        LawFormula("merge_heat", _pair, ("J",), BOUNCE, (0,), scale=energy_scale),
    ),
    properties=(
        LawProperty("energy", keeps_the_books, BOUNCE),
        LawProperty("slopes", slopes_bound_heats, DEFICIT_RANGE),
        LawProperty("unique", heat_rises_less_than_deficit, DEFICIT_RANGE),
    ),
)
REACTION_KIND: Final = LawKind(
    formulas=(LawFormula("contact_heat", lambda subject, point: (point["area"],), ("J",), AREA),),
    properties=(LawProperty("linear", is_proportional_to_area, AREA),),
)
DURATION_KIND: Final = LawKind(
    formulas=(
        LawFormula("force_scale", _pair, ("N",), PAIR_DOMAIN, (0,)),
        LawFormula(
            "restitution_factor",
            lambda subject, point: (1.0 - point["deficit"],),
            ("1",),
            {"deficit": BOUNCE["deficit"]},
        ),
        LawFormula(
            "restitution_factor_slope",
            lambda subject, point: (point["deficit"],),
            ("1",),
            {"deficit": BOUNCE["deficit"]},
        ),
    ),
    properties=(
        LawProperty("size", pressure_knows_no_size, PAIR_DOMAIN),
        LawProperty("factor", factor_never_falls, DEFICIT_RANGE),
        LawProperty("slope", factor_slope_is_right, DEFICIT_RANGE),
    ),
)
