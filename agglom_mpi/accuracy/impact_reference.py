"""Restitution known independently of the package: closed forms, and a search by brute force.

Everything is dimensionless. `X` is the pressure of a perfectly plastic impact over the one that
bonds it, both at the temperature that such an impact reaches, so that every pair bonds from X = 1.
The final contact area is the cross section of the smaller sphere, a_f = 1.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

LOWEST: Final = -60.0
"""Logarithm of the deficit d = 1 − e down to which the brute force looks for roots."""

POINTS: Final = 12_001
"""Points of a scan."""
NEAR: Final = 1e-3
"""A maximum of ln r − ln d this near below zero is scanned finely: two roots may touch there."""


class Material(NamedTuple):
    """What decides restitution, besides X.

    Attributes
    ----------
    mean_speed : bool
        Duration of the contact by [A 12]; else by [B 4.10].
    initial : float
        a₀, contact area of an elastic impact over the cross section.
    softening : float
        U/(Rθ) before the impact.
    rise : float
        Rise of the temperature by a perfectly plastic impact, over the temperature.
    """

    mean_speed: bool
    initial: float
    softening: float
    rise: float


class Exact(NamedTuple):
    """Exact outcome: whether it bonds, deficit 1 − e, number of roots, whether in closed form."""

    bonds: bool
    deficit: float
    roots: int
    closed: bool


def exact_impact(material: Material, x: float) -> Exact:
    """Return the outcome of an impact: the smallest root in e; bonding is decided first."""
    if x >= 1.0:
        return Exact(True, 1.0, 0, True)
    if material.softening * material.rise == 0.0:
        return Exact(False, closed_form(material, x), 1, True)
    return _brute_force(material, x)


def closed_form(material: Material, x: float) -> float:
    """Return the deficit of an impact without softening; for a₀ = 0 that of [B 4.14]."""
    a = material.initial
    if material.mean_speed:
        return 8.0 * x / (a + 4.0 * x + math.sqrt(a * a - 8.0 * a * x + 16.0 * x))
    return 2.0 * x / (a + math.sqrt(a * a + 4.0 * (1.0 - a) * x))


def excess(material: Material, x: float, logarithm: Any) -> Any:
    """Return ln r − ln d at ln d, an array of any precision, frictionless [A 6, 11–17] [B 3–4]."""
    d = np.exp(logarithm)
    area = material.initial + (1.0 - material.initial) * d
    force = (2.0 - d) ** 2 if material.mean_speed else np.ones_like(d)
    warm = 1.0 + material.rise * d * (2.0 - d)
    hardening = material.softening / warm - material.softening / (1.0 + material.rise)
    return np.log(np.longdouble(x)) + np.log(force / area) - hardening - logarithm


def _brute_force(material: Material, x: float) -> Exact:
    """Return the outcome by a dense scan from e = 0 up and bisection, in extended precision."""
    grid = np.linspace(np.longdouble(0.0), np.longdouble(LOWEST), POINTS)
    values = excess(material, x, grid)
    crossings = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    roots = int(np.count_nonzero((values[:-1] < 0.0) != (values[1:] < 0.0)))
    above, below = grid[crossings[0]], grid[crossings[0] + 1]
    for k in _grazing_roots(values, int(crossings[0])):
        fine = np.linspace(grid[k - 1], grid[k + 1], POINTS)
        touching = np.flatnonzero(excess(material, x, fine) >= 0.0)
        if len(touching):
            above, below, roots = fine[touching[0] - 1], fine[touching[0]], roots + 2
            break
    while True:
        middle = (above + below) / 2
        if middle in (above, below):
            return Exact(False, float(np.exp(below)), roots, False)
        if excess(material, x, middle) < 0.0:
            above = middle
        else:
            below = middle


def _grazing_roots(values: NDArray[np.longdouble], before: int) -> NDArray[np.intp]:
    """Return the indices of maxima before the crossing at index `before` that nearly are roots."""
    start = values[: before + 1]
    peaks = (start[1:-1] > start[:-2]) & (start[1:-1] >= start[2:]) & (start[1:-1] > -NEAR)
    return np.flatnonzero(peaks) + 1
