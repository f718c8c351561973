"""What each method makes of each impact: error, outcome, iterations and time, as frames."""

import itertools
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.accuracy.impact_methods import (
    hardness_of,
    impact_laws,
    published_iterations,
    seconds_per_impact,
    solve_all,
)
from agglom_mpi.accuracy.impact_reference import Exact, Material, exact_impact
from agglom_mpi.physics.impact_solvers import BracketedRoot, FixedPointIteration

if TYPE_CHECKING:
    import pandas as pd

ROOT: Final = "root finder"
TOLERANCES: Final = (1e-3, 1e-6, 1e-9)
CAPS: Final = (10, 100, 1000)
INITIAL: Final = (0.0, 0.01, 0.1, 1.0)
QUICK_INITIAL: Final = (0.0, 0.01)
SOFTENINGS: Final = {"none": (0.0, 0.0), "mild": (1.2, 1.0 / 3.0), "strong": (20.0, 1.0)}
"""U/(Rθ) before the impact, and rise of θ by a plastic impact over θ. Mild is as strong as the
papers' search boxes allow; strong has several roots."""
QUICK_SOFTENINGS: Final = ("none", "strong")
LEAST_TIMED: Final = 2000
DEMANDED: Final = 1e-6
"""Error of e that the conclusions ask for."""
ELSEWHERE: Final = 100.0
"""Tolerances from the smallest root beyond which the iteration has converged to another."""
OUTCOMES: Final = ("bonds", "solved", "another root", "at the cap", "inaccurate")


class Method(NamedTuple):
    """A way to solve an impact; cap and tolerance are nan for the root finder."""

    name: str
    solver: BracketedRoot | FixedPointIteration
    cap: float = math.nan
    tolerance: float = math.nan


def methods() -> Iterator[Method]:
    """Yield the root finder, and the published iteration with every cap and tolerance."""
    yield Method(ROOT, BracketedRoot())
    for cap, tolerance in itertools.product(CAPS, TOLERANCES):
        yield Method(name_of(cap, tolerance), FixedPointIteration(tolerance, cap), cap, tolerance)


def name_of(cap: int, tolerance: float) -> str:
    """Name of the published iteration with these limits."""
    return f"published, cap {cap}, to {tolerance:g}"


def materials(quick: bool) -> Iterator[tuple[str, Material]]:
    """Materials to measure, each with the name of its softening."""
    names = QUICK_SOFTENINGS if quick else tuple(SOFTENINGS)
    initial = QUICK_INITIAL if quick else INITIAL
    for mean_speed, a, name in itertools.product((True, False), initial, names):
        yield name, Material(mean_speed, a, *SOFTENINGS[name])


def measure(quick: bool) -> "pd.DataFrame":
    """Solve every impact by every method; one row each."""
    import pandas as pd

    slow, fast = (6, 12) if quick else (21, 48)  # where there are several roots, X is near 1
    x = np.concatenate([np.logspace(-6.0, -1.0, slow)[:-1], np.linspace(0.1, 1.98, fast)])
    parts = []
    for name, material in materials(quick):
        exact = [exact_impact(material, value) for value in x.tolist()]
        parts += [_solve(method, name, material, x, exact) for method in methods()]
    return pd.concat(parts, ignore_index=True)


def _solve(method: Method, softening: str, material: Material, x: Any, exact: list[Exact]) -> Any:
    """Solve all impacts of one material by one method; a frame."""
    import pandas as pd

    laws, hardness = impact_laws(material, method.solver), hardness_of(material, x)
    found = solve_all(laws, hardness)
    published = isinstance(method.solver, FixedPointIteration)
    bouncing = np.array([not one.bonds for one in exact])
    counts = published_iterations(laws, hardness) if published else np.full(len(x), math.nan)
    seconds = seconds_per_impact(laws, hardness[bouncing], LEAST_TIMED)
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
            "seconds per impact (s)": seconds,
        }
    )


def outcomes(impacts: "pd.DataFrame") -> Any:
    """Say what became of each impact, as indices of `OUTCOMES`, shape (n,)."""
    solved = impacts["error of e"] <= DEMANDED
    # An error of the size of the tolerance is what was asked for.
    another = ~impacts["capped"] & (impacts["error of e"] > ELSEWHERE * impacts["tolerance"])
    found = [impacts["found to bond"], solved, another, impacts["capped"]]
    return np.select(found, range(4), 4)


def summary(impacts: "pd.DataFrame") -> "pd.DataFrame":
    """One row for each method, over the impacts that do not bond."""
    import pandas as pd

    rows = []
    for name, own in impacts.groupby("method", sort=False):
        bounces = own[~own["bonds"]]
        error, became = bounces["error of e"], outcomes(bounces)
        seconds = bounces.groupby(["paper", "a0", "softening"])["seconds per impact (s)"].first()
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
                "seconds per impact (s)": float(seconds.median()),
                "longest of a material (s)": float(seconds.max()),
            }
        )
    return pd.DataFrame(rows)
