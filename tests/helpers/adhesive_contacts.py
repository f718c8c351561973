"""The JKR contact and other contact laws as plain functions, independent of the package's."""

import math

from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

# The JKR curve in units of R* = E* = Γ = 1, by the radius of the contact a.


def jkr_force(a):
    return 4.0 / 3.0 * a**3 - math.sqrt(8.0 * math.pi * a**3)


def jkr_overlap(a):
    return a * a - math.sqrt(2.0 * math.pi * a)


def jkr_overlap_slope(a):
    return 2.0 * a - math.sqrt(0.5 * math.pi / a)


def jkr_work(first, last):
    """Work of pulling a JKR contact from one radius of the contact to another, ∫F dδ."""
    work, error = quad(lambda a: jkr_force(a) * jkr_overlap_slope(a), first, last, epsabs=1e-12)
    assert error < 1e-10
    return work


def first_touch():
    """Radius of the contact at no overlap, into which spheres that meet jump."""
    return brentq(jkr_overlap, 1.0, 10.0, xtol=1e-14)


def least_overlap():
    """Radius of the contact at the least overlap, where it breaks at fixed displacement."""
    return brentq(jkr_overlap_slope, 1e-3, 10.0, xtol=1e-14)


def no_force():
    """Radius of the contact without a force from outside."""
    return brentq(jkr_force, 0.1, 10.0, xtol=1e-14)


def largest_pull():
    """Radius of the contact at the largest pull, where it breaks at fixed load."""

    def slope(a):
        return 4.0 * a * a - 1.5 * math.sqrt(8.0 * math.pi * a)

    return brentq(slope, 1e-3, no_force(), xtol=1e-14)


def adhesive_restitution(speed, damping):
    """e by integrating a viscous JKR contact, δ'' = −(F + A F'), in units of R* = E* = Γ = m* = 1.

    It starts at the first touch with `speed` w and ends at the least overlap, or in a bond, e = 0;
    A is `damping`. The total pull is at most the largest one of JKR, as a contact without adhesion
    cannot pull. The variable is τ, dt = (dδ/da) dτ, in which nothing is singular where the contact
    breaks.
    """
    least, pull = least_overlap(), -jkr_force(largest_pull())

    def rates(time, state):
        a, speed = max(state[0], 0.3 * least), state[1]
        slope, rate = jkr_overlap_slope(a), 4.0 * a * a - 1.5 * math.sqrt(8.0 * math.pi * a)
        return speed, -max(jkr_force(a) * slope + damping * speed * rate, -pull * slope)

    def stuck(time, state):
        return state[1]

    def parted(time, state):
        return state[0] - least

    stuck.terminal, stuck.direction = True, 1
    parted.terminal, parted.direction = True, -1
    start, events = (first_touch(), speed), (stuck, parted)
    found = solve_ivp(rates, (0.0, 1e6), start, "DOP853", events=events, rtol=1e-9, atol=1e-12)
    assert found.status == 1
    return 0.0 if len(found.t_events[0]) else -found.y[1, -1] / speed


def adhesive_sticking_speed(damping, near):
    """Speed up to which an integrated contact bonds, to 1e-4 of it; `near` is within a third."""
    low, high = near / 1.5, near * 1.5
    assert adhesive_restitution(low, damping) == 0.0 < adhesive_restitution(high, damping)
    while high > (1.0 + 1e-4) * low:
        middle = math.sqrt(low * high)
        if adhesive_restitution(middle, damping) == 0.0:
            low = middle
        else:
            high = middle
    return low


def viscoelastic_restitution(damping):
    """e by integrating ξ'' = −√ξ (ξ + g ξ') from ξ = 0, ξ' = 1 until the force is zero.

    g = β w^⅕ is `damping`; lengths and times are in units in which ρ/m* and w are 1.
    """

    def rates(time, state):
        overlap, speed = max(state[0], 0.0), state[1]
        return speed, -math.sqrt(overlap) * (overlap + damping * speed)

    def force(time, state):
        return state[0] + damping * state[1] if time > 1e-3 / (1.0 + damping) else 1.0

    force.terminal, force.direction = True, -1
    span = (0.0, 1e4)
    found = solve_ivp(rates, span, (0.0, 1.0), "DOP853", events=force, rtol=1e-9, atol=1e-12)
    assert found.status == 1
    return -found.y[1, -1]
