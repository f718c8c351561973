"""Impacts solved by the root finder and by the published iteration: errors, iterations and time.

Many impacts run in one compiled loop; a frame has a row for each impact and method.
"""

import itertools
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.impact_reference import Exact, Material, exact_impact
from agglom_mpi.accuracy.run_times import (
    WALL_OVER_CPU,
    ratio_of_clocks,
    time_columns,
    time_name,
)
from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.physics.constants import GAS_CONSTANT
from agglom_mpi.physics.contact import CompressionRecoveryDuration, ContactArea, MeanSpeedDuration
from agglom_mpi.physics.hardness import ArrheniusHardness
from agglom_mpi.physics.heating import PairSplit
from agglom_mpi.physics.impact_solvers import BracketedRoot, FixedPointIteration
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import (
    ImpactLaws,
    PressureRestitution,
    log_pressure_ratio,
    log_pressure_scale,
    solve_restitution,
)
from agglom_mpi.stopwatch import Stopwatch

if TYPE_CHECKING:
    import pandas as pd

DENSITY: Final = 5000.0
RADIUS: Final = 1e-3
SPEED: Final = 1.0
TEMPERATURE: Final = 300.0
PAIR: Final = ContactPair(
    approach_speed=SPEED,
    slip_speed=0.0,
    mass_i=DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3,
    mass_j=DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3,
    reduced_mass=DENSITY * 2.0 / 3.0 * math.pi * RADIUS**3,
    radius=RADIUS,
    radius_i=RADIUS,
    radius_j=RADIUS,
    temperature_i=TEMPERATURE,
    temperature_j=TEMPERATURE,
    normal_i=SPEED,
    normal_j=0.0,
    tangent_i=0.0,
    tangent_j=0.0,
)
"""Equal spheres, head on; X is set by the hardness, which alone differs between the impacts."""

REPEATS: Final = 3
"""Number of timed loops; the median is reported."""

TIME: Final = time_name("impact")
"""Column of the median time of an impact."""

ROOT: Final = "root finder"
"""Name of the package's method."""
TOLERANCES: Final = (1e-3, 1e-6, 1e-9)
CAPS: Final = (10, 100, 1000)
INITIAL: Final = (0.0, 0.01, 0.1, 1.0)
"""Initial contact areas a₀ over the cross section."""
QUICK_INITIAL: Final = (0.0, 0.01)
SOFTENINGS: Final = {"none": (0.0, 0.0), "mild": (1.2, 1.0 / 3.0), "strong": (20.0, 1.0)}
"""U/(Rθ) before the impact, and rise of θ by a plastic impact over θ. Mild is as strong as the
papers' search boxes allow; strong has several roots."""
QUICK_SOFTENINGS: Final = ("none", "strong")
LEAST_TIMED: Final = 2000
"""Impacts of a timed loop, at least."""
DEMANDED: Final = 1e-6
"""Error of e that the conclusions ask for."""
ELSEWHERE: Final = 100.0
"""Tolerances from the smallest root beyond which the iteration has converged to another."""
OUTCOMES: Final = ("bonds", "solved", "another root", "at the cap", "inaccurate")


class Solutions(NamedTuple):
    """Solved impacts, shape (n,): deficit 1 − e, whether they bond, whether they end at the cap."""

    deficit: NDArray[np.float64]
    bonds: NDArray[np.bool_]
    capped: NDArray[np.bool_]


def impact_laws(material: Material, solver: Any) -> ImpactLaws:
    """Return the laws of a material for `PAIR`; the kernels fill in the hardness."""
    energy = material.softening * GAS_CONSTANT * TEMPERATURE
    # Each sphere gets half of ½m*w², and m* is half its mass.
    heated = SPEED**2 / (8.0 * TEMPERATURE)
    return ImpactLaws(
        restitution=PressureRestitution.Numbers(),
        duration=MeanSpeedDuration.Numbers(1e-6)
        if material.mean_speed
        else CompressionRecoveryDuration.Numbers(1.0),
        contact_area=ContactArea.Numbers(material.initial, 1.0),
        hardness=ArrheniusHardness.Numbers(1.0, energy),
        friction=None,
        heating=PairSplit.Numbers(),
        reaction=None,
        fragmentation=None,
        solver=solver,
        heat_capacity=heated / material.rise if material.rise > 0.0 else math.inf,
    )


def hardness_of(material: Material, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return H₀ in Pa at which `PAIR` has these X, shape (n,)."""
    length = (1e-6 if material.mean_speed else 1.0) * RADIUS
    force = PAIR.reduced_mass * SPEED**2 / (2.0 * length)
    hardening = math.exp(material.softening / (1.0 + material.rise))
    return force / (2.0 * math.pi * RADIUS**2) / (hardening * x)


HARDNESS: Final = ArrheniusHardness.Numbers
"""Numbers of the hardness law of all impacts, by a name that kernels know."""


@kernel
def with_hardness(laws, base):
    """Return the same laws with another H₀ in Pa."""
    return ImpactLaws(
        laws.restitution,
        laws.duration,
        laws.contact_area,
        HARDNESS(base, laws.hardness.activation_energy),
        laws.friction,
        laws.heating,
        laws.reaction,
        laws.fragmentation,
        laws.solver,
        laws.heat_capacity,
    )


@kernel
def solve_repeatedly(laws, pair, hardness, repeats, deficit, bonds, capped):
    """Solve the impact of a pair at every H₀ in Pa, `repeats` times over; fills the last three."""
    for _ in range(repeats):
        for i in range(hardness.size):
            own = with_hardness(laws, hardness[i])
            solution = solve_restitution(own.restitution, own, pair)
            deficit[i] = solution.deficit
            bonds[i] = solution.bonds
            capped[i] = solution.capped


@kernel
def iterate_as_published(laws, pair, hardness, deficit, count):
    """Count the iterations of the published method, which the package does not report.

    The same loop as `FixedPointIteration`: e ← G(e) from e = 0  [A 20] [B 6b].
    """
    for i in range(hardness.size):
        own = with_hardness(laws, hardness[i])
        scale = log_pressure_scale(own, pair)
        deficit[i] = 1.0
        count[i] = 0
        if log_pressure_ratio(own, pair, scale, 1.0) >= 0.0:
            continue
        change = math.inf
        while change > laws.solver.tolerance and count[i] < laws.solver.cap:
            log_ratio = log_pressure_ratio(own, pair, scale, deficit[i])
            following = math.exp(log_ratio) if log_ratio < 0.0 else 1.0
            change = abs(following - deficit[i])
            deficit[i] = following
            count[i] += 1


def solve_all(laws: ImpactLaws, hardness: NDArray[np.float64]) -> Solutions:
    """Solve the impact of `PAIR` at every H₀ in Pa, shape (n,)."""
    count = len(hardness)
    found = Solutions(np.empty(count), np.empty(count, np.bool_), np.empty(count, np.bool_))
    solve_repeatedly(laws, PAIR, hardness, 1, *found)
    return found


def published_iterations(laws: ImpactLaws, hardness: NDArray[np.float64]) -> NDArray[np.int64]:
    """Count the iterations of the published method at every H₀ in Pa, shape (n,)."""
    count = np.empty(len(hardness), np.int64)
    iterate_as_published(laws, PAIR, hardness, np.empty(len(hardness)), count)
    return count


def time_of_impact(laws: ImpactLaws, hardness: NDArray[np.float64], least: int) -> dict[str, float]:
    """Return the processor time of an impact as columns, of loops over at least `least` impacts."""
    repeats = -(-least // len(hardness))
    found = solve_all(laws, hardness)
    times = []
    for _ in range(REPEATS):
        stopwatch = Stopwatch()
        solve_repeatedly(laws, PAIR, hardness, repeats, *found)
        times.append(stopwatch.read())
    seconds = np.array([spent.cpu for spent in times]) / (repeats * len(hardness))
    return time_columns("impact", seconds) | {WALL_OVER_CPU: ratio_of_clocks(times)}


class Method(NamedTuple):
    """A way to solve an impact; cap and tolerance are nan for the root finder."""

    name: str
    solver: BracketedRoot | FixedPointIteration
    cap: float = math.nan
    tolerance: float = math.nan


def methods() -> Iterator[Method]:
    """Yield the root finder, and the published iteration with every cap and tolerance."""
    yield Method(ROOT, BracketedRoot.Numbers())
    for cap, tolerance in itertools.product(CAPS, TOLERANCES):
        yield Method(
            name_of(cap, tolerance), FixedPointIteration.Numbers(tolerance, cap), cap, tolerance
        )


def name_of(cap: int, tolerance: float) -> str:
    """Return the name of the published iteration with these limits."""
    return f"published, cap {cap}, to {tolerance:g}"


def materials(quick: bool) -> Iterator[tuple[str, Material]]:
    """Yield the materials to measure, each after the name of its softening."""
    names = QUICK_SOFTENINGS if quick else tuple(SOFTENINGS)
    initial = QUICK_INITIAL if quick else INITIAL
    for mean_speed, a, name in itertools.product((True, False), initial, names):
        yield name, Material(mean_speed, a, *SOFTENINGS[name])


def measure(quick: bool) -> "pd.DataFrame":
    """Return the solution of every impact by every method, one row each."""
    import pandas as pd

    slow, fast = (6, 12) if quick else (21, 48)  # where there are several roots, X is near 1
    x = np.concatenate([np.logspace(-6.0, -1.0, slow)[:-1], np.linspace(0.1, 1.98, fast)])
    parts = []
    for name, material in materials(quick):
        exact = [exact_impact(material, value) for value in x.tolist()]
        parts += [_solve(method, name, material, x, exact) for method in methods()]
    return pd.concat(parts, ignore_index=True)


def _solve(method: Method, softening: str, material: Material, x: Any, exact: list[Exact]) -> Any:
    """Return the impacts of one material solved by one method, one row each."""
    import pandas as pd

    laws, hardness = impact_laws(material, method.solver), hardness_of(material, x)
    found = solve_all(laws, hardness)
    published = not math.isnan(method.cap)
    bouncing = np.array([not one.bonds for one in exact])
    counts = published_iterations(laws, hardness) if published else np.full(len(x), math.nan)
    seconds = time_of_impact(laws, hardness[bouncing], LEAST_TIMED)
    return pd.DataFrame(
        {
            "method": method.name,
            "cap": method.cap,
            "tolerance": method.tolerance,
            "paper": "[A]" if material.mean_speed else "[B]",
            "a0": material.initial,
            "softening": softening,
            "X": x,
            "roots": [one.roots for one in exact],
            "closed form": [one.closed for one in exact],
            "bonds": [one.bonds for one in exact],
            "found to bond": found.bonds,
            "e": [1.0 - one.deficit for one in exact],
            "error of e": np.abs(found.deficit - [one.deficit for one in exact]),
            "capped": found.capped,
            "iterations": counts,
            **seconds,
        }
    )


def outcomes(impacts: "pd.DataFrame") -> Any:
    """Return the outcome of each impact as an index of `OUTCOMES`, shape (n,)."""
    solved = impacts["error of e"] <= DEMANDED
    # An error of the size of the tolerance is what was asked for.
    another = ~impacts["capped"] & (impacts["error of e"] > ELSEWHERE * impacts["tolerance"])
    found = [impacts["found to bond"], solved, another, impacts["capped"]]
    return np.select(found, range(4), 4)


def summary(impacts: "pd.DataFrame") -> "pd.DataFrame":
    """Return one row for each method, over the impacts that do not bond."""
    import pandas as pd

    rows = []
    for name, own in impacts.groupby("method", sort=False):
        bounces = own[~own["bonds"]]
        error, became = bounces["error of e"], outcomes(bounces)
        materials = bounces.groupby(["paper", "a0", "softening"])[[TIME, WALL_OVER_CPU]].first()
        rows.append(
            {
                "method": name,
                "cap": own["cap"].iloc[0],
                "tolerance": own["tolerance"].iloc[0],
                "bounces": len(bounces),
                "wrongly bonded or not": int((own["bonds"] != own["found to bond"]).sum()),
                "solved": int((became == 1).sum()),
                "another root": int((became == 2).sum()),
                "capped": int(bounces["capped"].sum()),
                "median error of e": float(error.median()),
                "worst error of e": float(error.max()),
                "median iterations": float(bounces["iterations"].median()),
                **time_columns("impact", materials[TIME]),
                "longest of a material (s)": float(materials[TIME].max()),
                WALL_OVER_CPU: float(materials[WALL_OVER_CPU].median()),
            }
        )
    return pd.DataFrame(rows)
