"""Properties of laws of an impact: restitution, duration, hardness, friction, heating, reaction."""

import math
from typing import Any, Final

from agglom_mpi.compilation.kernels import as_plain
from agglom_mpi.contracts.cases import RESULT_ROUNDING, Violation, equal, within
from agglom_mpi.contracts.subject import Case
from agglom_mpi.physics.friction import (
    normal_loss,
    tangential_impulse,
    tangential_loss,
    tangential_mass,
)
from agglom_mpi.physics.heating import merge_dissipation
from agglom_mpi.physics.impact_solvers import LARGEST_RESIDUAL, restitution_residual
from agglom_mpi.physics.restitution import (
    log_pressure_ratio,
    log_pressure_scale,
    solve_restitution,
)
from agglom_mpi.simulation.impact import solve_impact

ENERGY_ROUNDING: Final = 1e-12
"""Relative rounding of an energy: some ten operations of 1.1e-16 each, and a margin."""

ONE: Final = 1.0 + ENERGY_ROUNDING

LEAST_CHANGE: Final = 1e-5
"""Least change of ln H that is compared with its derivative: rounding is 1e-16 of ln H itself."""

SCANNED: Final = 240
"""Number of deficits in the scan for a missed root."""
LOWEST_LOG_DEFICIT: Final = -24.0
"""ln d of the smallest of these deficits."""
MOST_LOG: Final = 300.0
"""Maximum change of ln H0 to come near bonding."""

EXACT: Final = 4.0 * 2.0**-52
"""Rounding of a number within 0 … 1 that one subtraction gives."""


def energy_scale(case: Case) -> float:
    """Return the size of the kinetic energies in J whose differences heats are."""
    pair, point = case.pair, case.numbers
    frame = abs(point.get("frame_along_n", 0.0)) + abs(point.get("frame_along_t", 0.0))
    components = (pair.normal_i, pair.normal_j, pair.tangent_i, pair.tangent_j)
    speeds = sum(map(abs, components)) + 2.0 * frame
    return max(pair.mass_i, pair.mass_j) * speeds * speeds


def within_limits(case: Case) -> Violation:
    """Check that restitution is within 0 … 1."""
    deficit = case.call("solve_restitution", case.laws, case.pair)[0]
    if -EXACT <= deficit <= 1.0 + EXACT:
        return None
    return f"restitution is {1.0 - deficit:.9g}, not within 0 ... 1"


def makes_no_energy(case: Case) -> Violation:
    """Check that no impact makes kinetic energy, and that its loss is what is gone."""
    pair = case.but(normal_j=0.0, tangent_j=0.0).pair
    impact = as_plain(solve_impact)(case.laws, pair)
    if impact.bonds:
        return None
    sliding = tangential_mass(case.laws.friction, pair)  # whose energy may be that of spins
    squares = pair.approach_speed**2, pair.slip_speed**2
    before = 0.5 * (pair.reduced_mass * squares[0] + sliding * squares[1])
    normal = pair.approach_speed - impact.normal_impulse / pair.reduced_mass
    slip = pair.slip_speed - impact.friction_impulse / sliding
    after = 0.5 * (pair.reduced_mass * normal * normal + sliding * slip * slip)
    kept, lost = after / before, impact.loss / before
    return within("kinetic energy after an impact over that before", kept, 0.0, ONE) or equal(
        "the recorded loss over the energy before", lost, 1.0 - kept, ENERGY_ROUNDING
    )


def never_drives_slip(case: Case) -> Violation:
    """Check that friction acts against the slip, and at most ends it."""
    impulse = case.call("tangential_impulse", case.pair, case["deficit"])
    most = case.pair.reduced_mass * case.pair.slip_speed * ONE
    return within("the friction impulse in N s", impulse, 0.0, most)


def slopes_bound_impulse(case: Case) -> Violation:
    """Check that the slope of the friction impulse with the deficit is within `impulse_slopes`."""
    lower, middle, upper = deficits = case.deficits
    least, most = case.call("impulse_slopes", case.pair, lower, upper)
    low, mid, high = (case.call("tangential_impulse", case.pair, each) for each in deficits)
    margin = ENERGY_ROUNDING * max(abs(low), abs(mid), abs(high))

    def wrong(width: float, change: float) -> Violation:
        what = f"the change of the impulse in N s over a width of {width:.3g}"
        return within(what, change, least * width - margin, most * width + margin)

    return wrong(middle - lower, mid - low) or wrong(upper - middle, high - mid)


def keeps_the_books(case: Case) -> Violation:
    """Check that both heats are the kinetic energy that the pair loses, also in a merge."""
    pair, friction, deficit = case.pair, case.laws.friction, case["deficit"]
    margin = ENERGY_ROUNDING * energy_scale(case)
    loss = normal_loss(pair, deficit)
    loss += tangential_loss(friction, pair, tangential_impulse(friction, pair, deficit))
    heat = sum(case.call("impact_heats", friction, pair, deficit))
    merged, lost = case.call("merge_heat", pair), merge_dissipation(pair)
    return equal("the heat of the lost motion in J", heat, loss, margin) or equal(
        "the heat of a merge in J", merged, lost, margin
    )


def slopes_bound_heats(case: Case) -> Violation:
    """Check that each heat is below the line of `least_heat_slopes` through its upper end."""
    pair, friction = case.pair, case.laws.friction
    lower, middle, upper = case.deficits
    slopes = case.call("least_heat_slopes", friction, pair, lower, upper)
    ends, inner = (case.call("impact_heats", friction, pair, each) for each in (upper, middle))
    margin = ENERGY_ROUNDING * energy_scale(case)
    for end, heat, slope in zip(ends, inner, slopes, strict=True):
        line = end - slope * (upper - middle)
        if heat > line + margin:
            return f"a heat is {heat:.9g} J at deficit {middle:.6g}; the line gives {line:.9g} J"
    return None


def heat_rises_less_than_deficit(case: Case) -> Violation:
    """Check that heat over deficit never rises without friction, if `keeps_root_unique`."""
    _, middle, upper = case.deficits
    if middle == 0.0 or not case.call("keeps_root_unique"):
        return None
    heats = (case.call("impact_heats", None, case.pair, each) for each in (middle, upper))
    for low, high in zip(*heats, strict=True):
        if high * middle > low * upper + RESULT_ROUNDING * abs(low) * upper:
            return f"heat over deficit rises from {low / middle:.9g} J to {high / upper:.9g} J"
    return None


def is_proportional_to_area(case: Case) -> Violation:
    """Check that the heat of reaction is proportional to the area, as the root finder assumes."""
    first, second = case["area"], case["area"] * case["area_ratio"]
    one, other, whole = (
        case.call("contact_heat", each) for each in (first, second, first + second)
    )
    margin = RESULT_ROUNDING * (abs(one) + abs(other))
    return equal("the heat of an area in J, and of its parts,", whole, one + other, margin)


def factor_never_falls(case: Case) -> Violation:
    """Check that `restitution_factor` is positive and never falls with the restitution."""
    _, middle, upper = case.deficits
    low, high = (case.call("restitution_factor", 1.0 - each) for each in (upper, middle))
    if 0.0 < low <= high * ONE:
        return None
    return f"the factor is {low:.9g} at e = {1.0 - upper:.6g} and {high:.9g} at {1.0 - middle:.6g}"


def factor_slope_is_right(case: Case) -> Violation:
    """Check that `restitution_factor_slope` is -d ln(factor)/d ln d, and never falls with d."""
    _, middle, upper = case.deficits
    if middle < 1e-6 * upper or middle > 0.99 * upper:
        return None
    low, high = (case.call("restitution_factor", 1.0 - each) for each in (middle, upper))
    least, most = (case.call("restitution_factor_slope", each) for each in (middle, upper))
    mean = math.log(low / high) / math.log(upper / middle)
    margin = 1e-9  # of a difference of logarithms over at least 0.01
    return within("the slope between two deficits", mean, least - margin, most + margin)


def pressure_knows_no_size(case: Case) -> Violation:
    """Check that the pressure of equal grains is positive, and the same for every radius."""
    first, second = (
        case.call("force_scale", case.but(radius_i=each, radius_j=each).pair) / each**2
        for each in (case["radius_i"], case["radius_j"])
    )
    if first > 0.0:
        what = "force over radius squared for another radius in Pa"
        return equal(what, second, first, RESULT_ROUNDING * first)
    return f"force over radius squared is {first:.9g} Pa"


def _of_both(case: Case, formula: str) -> tuple[float, float, float, float]:
    """Return two temperatures of a grain in K, the lower one first, and a formula at both."""
    cold = case["temperature_of_grain"]
    warm = cold * (1.0 + case["warmer_by"])
    return cold, warm, case.call(formula, cold), case.call(formula, warm)


def hardness_falls(case: Case) -> Violation:
    """Check that hardness never rises with the temperature."""
    cold, warm, first, second = _of_both(case, "log_hardening")
    if second <= first + 1e-12 * abs(first):
        return None
    return f"ln(H/H0) rises from {first:.9g} at {cold:.6g} K to {second:.9g} at {warm:.6g} K"


def softening_is_derivative(case: Case) -> Violation:
    """Check that `softening_rate` is -d ln H/dtheta, by the mean slope between two ends."""
    cold, warm, first, second = _of_both(case, "log_hardening")
    low, high = sorted(_of_both(case, "softening_rate")[2:])
    if math.isfinite(first) and abs(first - second) >= LEAST_CHANGE * max(1.0, abs(first)):
        mean = (first - second) / (warm - cold)
        margin = 1e-9 * mean  # 1e-16 of ln H over its least change
        what = f"the fall of ln H per K from {cold:.6g} to {warm:.6g} K"
        return within(what, mean, low - margin, high + margin)
    if first == second and math.isfinite(first) and low > 0.0:
        return f"ln H does not change, but softening_rate is {low:.9g}/K"
    return None


def softening_never_rises(case: Case) -> Violation:
    """Check that `softening_rate` is not negative and never rises, as the root finder assumes."""
    cold, warm, first, second = _of_both(case, "softening_rate")
    if 0.0 <= second <= first * (1.0 + 1e-12):
        return None
    rates = f"{first:.9g}/K at {cold:.6g} K and {second:.9g}/K at {warm:.6g} K"
    return f"softening_rate is {rates}; it must not rise"


def root_is_the_smallest(case: Case) -> Violation:
    """Check that a dense scan finds no smaller root of e = G(e) than the solver."""
    heat = case["heat_capacity"] * case["temperature_i"]
    pair = case.but(approach_speed=math.sqrt(case["heat_ratio"] * heat)).pair
    laws: Any = case.laws
    excess = log_pressure_ratio(laws, pair, log_pressure_scale(laws, pair), 1.0)
    excess -= math.log(case["pressure_ratio"])
    if "hardness" in laws.hardness._fields and abs(excess) < MOST_LOG:
        chosen = laws.hardness.hardness * math.exp(excess)
        laws = laws._replace(hardness=laws.hardness._replace(hardness=chosen))
    solution = solve_restitution(laws.restitution, laws, pair)
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
            lower = f"there is a root below e = {-math.expm1(place):.9g}"
            return f"e = {1.0 - solution.deficit:.9g} was found, but {lower}"
    return None
