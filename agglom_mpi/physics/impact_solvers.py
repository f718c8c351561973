"""Solvers of e = G(e): a root finder that cannot fail, and the published fixed-point iteration.

Bonding is decided first: r(d=1) ≥ 1. Otherwise the impact is the smallest root in e, that is the
largest in the deficit d, which a sufficiently relaxed iteration from e = 0 finds too.
"""

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Final, Literal

from agglom_mpi.compilation.stages import inlined
from agglom_mpi.declaration.components import In, Whole
from agglom_mpi.physics.hardness import root_is_unique
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import (
    ImpactLaws,
    RestitutionSolution,
    Solver,
    log_pressure_ratio,
    log_pressure_scale,
    root_free_step,
)

SMALLEST_LOG: Final = -600.0
"""ln d below which the impact is elastic: the pressure on so small an area soon overflows."""

TOLERANCE: Final = 4e-15
STEP_CAP: Final = 10_000

LARGEST_RESIDUAL: Final = 1e-6
"""Largest |e − G(e)| at a root of laws that are smooth: `TOLERANCE` of ln d times the slope of
ln r, which grows with the hardening U/(Rθ), and rounding; seen are 1e-10. A jump leaves its height.
"""


@inlined
def lower_bracket(laws: ImpactLaws, pair: ContactPair, scale: float, start: float) -> float:
    """Find ln d with r(d) ≥ d below `start` = ln r(1) < 0; below `SMALLEST_LOG` the search ends."""
    trial = start
    excess = log_pressure_ratio(laws, pair, scale, math.exp(trial)) - trial
    while excess < 0.0 and trial >= SMALLEST_LOG:
        trial += 2.0 * excess - 1.0
        excess = log_pressure_ratio(laws, pair, scale, math.exp(trial)) - trial
    return trial


@inlined
def unique_root(laws: ImpactLaws, pair: ContactPair, scale: float, plastic: float) -> float:
    """Ln d of the only root, by Chandrupatla's bracketing method; `plastic` = ln r(1) < 0.

    T. R. Chandrupatla, Adv. Eng. Softw. 28 (1997) 145–149: inverse quadratic interpolation where
    it is safe, bisection elsewhere.
    """
    a = 0.0
    fa = plastic
    b = lower_bracket(laws, pair, scale, plastic)
    if b < SMALLEST_LOG:
        return b
    fb = log_pressure_ratio(laws, pair, scale, math.exp(b)) - b
    c, fc = a, fa
    fraction = fa / (fa - fb) if fb != math.inf else 0.5
    while True:
        x = a + fraction * (b - a)
        fx = log_pressure_ratio(laws, pair, scale, math.exp(x)) - x
        if (fx < 0.0) == (fa < 0.0):
            c, fc = a, fa
        else:
            c, fc = b, fb
            b, fb = a, fa
        a, fa = x, fx
        best = a if abs(fa) < abs(fb) else b
        limit = TOLERANCE * max(1.0, abs(best)) / abs(b - a)
        if not limit <= 0.5 or fa == 0.0 or fb == 0.0:  # what is no number ends it too
            return a if fa == 0.0 else (b if fb == 0.0 else best)
        fraction = interpolation_fraction(a, b, c, fa, fb, fc)
        fraction = min(1.0 - limit, max(limit, fraction))


@inlined
def interpolation_fraction(a: float, b: float, c: float, fa: float, fb: float, fc: float) -> float:
    """Chandrupatla's next point as a fraction of the way from a to b; 0.5 bisects."""
    xi = (a - b) / (c - b)
    phi = (fa - fb) / (fc - fb)
    if phi * phi < xi and (1.0 - phi) * (1.0 - phi) < 1.0 - xi:
        return fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
    return 0.5


@inlined
def first_root(laws: ImpactLaws, pair: ContactPair, scale: float) -> tuple[float, int]:
    """Ln d of the largest root in d, and the number of steps; `STEP_CAP` steps if that ended it.

    Steps down in ln d from 0; each is proven to hold no root, so none is jumped over however many
    there are or however nearly they touch. Near a root the steps are Newton's, and at two roots
    that nearly touch they shrink only with the square root of the gap.
    """
    upper = 0.0
    trial = 1.0
    for count in range(1, STEP_CAP):
        step = root_free_step(laws, pair, scale, upper, trial)
        upper -= step
        trial = 2.0 * step if step > 0.0 else 0.25 * trial
        if upper < SMALLEST_LOG or trial < TOLERANCE * max(1.0, abs(upper)):
            return upper, count
    return upper, STEP_CAP


@inlined
def restitution_residual(
    laws: ImpactLaws, pair: ContactPair, scale: float, deficit: float
) -> float:
    """|e − G(e)|, dimensionless."""
    log_ratio = log_pressure_ratio(laws, pair, scale, deficit)
    ratio = math.exp(log_ratio) if log_ratio < 0.0 else 1.0
    return abs(ratio - deficit)


class BracketedRoot(Solver):
    """Bracketing in ln d where the root is unique, certified steps up from e = 0 elsewhere."""

    law: Literal["root"] = "root"
    summary: ClassVar[str] = "e = G(e) by a bracketed root finder"
    largest_residual = LARGEST_RESIDUAL

    def solve_pressure_law(self, laws, pair):
        """Smallest root in e, by bracketing."""
        scale = log_pressure_scale(laws, pair)
        plastic = log_pressure_ratio(laws, pair, scale, 1.0)
        if plastic >= 0.0:
            return RestitutionSolution(1.0, True, 0.0, False)
        if scale == -math.inf:
            return RestitutionSolution(0.0, False, 0.0, False)
        steps = 0
        if root_is_unique(laws.hardness, laws, pair):
            logarithm = unique_root(laws, pair, scale, plastic)
        else:
            logarithm, steps = first_root(laws, pair, scale)
        if logarithm < SMALLEST_LOG:
            return RestitutionSolution(0.0, False, 0.0, steps == STEP_CAP)
        deficit = math.exp(logarithm)
        residual = restitution_residual(laws, pair, scale, deficit)
        return RestitutionSolution(deficit, False, residual, steps == STEP_CAP)


class FixedPointIteration(Solver):
    """e ← G(e) from e = 0 until |Δe| ≤ `tolerance` or `cap` iterations  [A 20] [B 6b].

    Bonding is tested at e = 0 only. It does not converge for most impacts; the residual tells.

    Attributes
    ----------
    tolerance
        Change of e at which it ends.
    cap
        Most iterations of an impact.
    """

    law: Literal["iteration"] = "iteration"
    tolerance: Annotated[float, In("1", above=0)] = 1e-6
    cap: Annotated[int, Whole(at_least=1)] = 100
    summary: ClassVar[str] = "the published fixed point, which cycles for most impacts [A 20]"
    breaks: ClassVar[Mapping[str, str]] = {"root": "as published, it cycles for most impacts"}

    def solve_pressure_law(self, laws, pair):
        """Where the iteration ends."""
        scale = log_pressure_scale(laws, pair)
        if log_pressure_ratio(laws, pair, scale, 1.0) >= 0.0:
            return RestitutionSolution(1.0, True, 0.0, False)
        deficit = 1.0
        for _ in range(self.cap):
            log_ratio = log_pressure_ratio(laws, pair, scale, deficit)
            following = math.exp(log_ratio) if log_ratio < 0.0 else 1.0
            change = abs(following - deficit)
            deficit = following
            if change <= self.tolerance:
                residual = restitution_residual(laws, pair, scale, deficit)
                return RestitutionSolution(deficit, False, residual, False)
        return RestitutionSolution(
            deficit, False, restitution_residual(laws, pair, scale, deficit), True
        )
