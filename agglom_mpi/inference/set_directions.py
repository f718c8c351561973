"""Which variables decide whether a string is in a feasible set, and in which combinations."""

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.config.coordinates import Group
from agglom_mpi.inference.emulated_set import EmulatedSet
from agglom_mpi.inference.set_points import OUTER_PROBABILITY, SetPoints
from agglom_mpi.statistics import Floats, weighted_quantiles

if TYPE_CHECKING:
    import pandas as pd

SLOPE_MEMBERS: Final = 300
"""Number of members at which the slopes are taken."""
SLOPE_STEP: Final = 0.02
"""Half of the step of a slope, in units of the box."""
MIN_FREE_SHARE: Final = 0.8
"""Minimum share of its range over which a free variable may be moved, on average."""
MOVED_MEMBERS, MOVED_PLACES = 150, 12
"""Number of members that are moved along each variable, and of places that they are moved to."""
MIN_COSINE: Final = 0.95
"""Minimum cosine of the angle to a group's direction, in units of the box, of one near the group.
"""
MIN_COMPONENT: Final = 0.1
"""Minimum component for a variable to count as part of a group, in units of the box."""
EDGE_WIDTH: Final = 0.03
"""Width of the ends of a range at which densities are measured, relative to the range."""
MIN_EDGE_DENSITY: Final = 0.2
"""Minimum density at an end that is touched, relative to the largest density."""
DENSITY_BINS: Final = 20
"""Number of bins of a range whose densities are compared."""
QUARTER_PREFERENCE: Final = 0.02
"""Minimum advantage in distance of a third over a quarter as an exponent."""


class SetVariable(NamedTuple):
    """A searched variable in the feasible set, in SI units.

    Attributes
    ----------
    name, unit
    lower, upper
        The range that was searched.
    least, most
        Range of the outer set.
    low, median, high
        Quantiles of the set: 5 %, 50 % and 95 % of it lie below.
    kept
        Share of its range over which a member may be moved, the others kept, and stay a member.
    free
        Whether that share is at least `MIN_FREE_SHARE`. A free variable decides nothing; any other
        is decided, alone or together with others.
    touches
        Edges of the box that the set touches, `lower` or `upper`; the set may go on there.
    """

    name: str
    unit: str
    lower: float
    upper: float
    least: float
    most: float
    low: float
    median: float
    high: float
    kept: float
    free: bool
    touches: tuple[str, ...]


def set_variables(emulated: EmulatedSet, points: SetPoints) -> list[SetVariable]:
    """Return the searched variables of a set, in their order; none if the set is empty."""
    mass = points.mass
    if mass.sum() <= 0.0:
        return []
    kept = _kept_shares(emulated, points)
    units = emulated.box.space.to_unit(points.strings)
    # A range that was narrowed on both sides ends within the box.
    narrowed = (points.lower > 0.0) & (points.upper < 1.0)
    found = []
    for place, variable in enumerate(emulated.box.own):
        values = variable.values(points.strings)
        outer = values[points.probability >= OUTER_PROBABILITY]
        outer = values[points.probability > 0.0] if not len(outer) else outer
        low, median, high = weighted_quantiles(values, mass, (0.05, 0.5, 0.95))
        found.append(
            SetVariable(
                variable.name,
                variable.unit,
                variable.lower,
                variable.upper,
                float(outer.min()),
                float(outer.max()),
                low,
                median,
                high,
                float(kept[place]),
                bool(kept[place] >= MIN_FREE_SHARE),
                () if narrowed[place] else touched_ends(units[:, place], mass),
            )
        )
    return found


def touched_ends(units: Floats, mass: Floats) -> tuple[str, ...]:
    """Return the ends of a variable's range at which points with mass are as dense as elsewhere."""
    places = np.minimum((units * DENSITY_BINS).astype(np.int64), DENSITY_BINS - 1)
    largest = np.bincount(places, mass, DENSITY_BINS).max() * DENSITY_BINS
    ends = {"lower": units < EDGE_WIDTH, "upper": units > 1.0 - EDGE_WIDTH}
    return tuple(
        name
        for name, at in ends.items()
        if mass[at].sum() / EDGE_WIDTH > MIN_EDGE_DENSITY * largest
    )


def name_ends(variable: Any, ends: tuple[str, ...]) -> str:
    """Return ends of a variable's range as text: `the lower end 0.1 of friction`."""
    shown = " and ".join(f"the {end} end {getattr(variable, end):.4g}" for end in ends)
    return f"{shown} of {variable.name}"


def _kept_shares(emulated: EmulatedSet, points: SetPoints) -> Floats:
    """Return the share of its range over which each variable may be moved, on average, (d,)."""
    members, space = points.even_members(MOVED_MEMBERS), emulated.box.space
    start = space.to_unit(members)
    here = emulated.probability(members).mean()
    places = (np.arange(MOVED_PLACES) + 0.5) / MOVED_PLACES
    shares = []
    for i in range(start.shape[1]):
        moved = np.repeat(start, MOVED_PLACES, axis=0)
        moved[:, i] = np.tile(places, len(start))
        strings = space.from_unit(moved)
        there = emulated.probability(strings)[emulated.box.allowed(strings)]
        shares.append(min(1.0, float(there.mean() / here)) if len(there) and here > 0.0 else 0.0)
    return np.array(shares)


def set_directions(emulated: EmulatedSet, points: SetPoints) -> "pd.DataFrame":
    """Return the active directions of a set (Constantine 2015); see `FeasibleSet.directions`."""
    import pandas as pd

    names, coordinates = emulated.box.names, emulated.coordinates
    columns = ["eigenvalue", "share", *names, "group", "cosine"]
    if points.volume <= 0.0:
        return pd.DataFrame(columns=columns)
    slopes = _slopes(emulated, points)
    values, vectors = np.linalg.eigh(slopes.T @ slopes / len(slopes))
    if values.sum() <= 0.0:  # the emulated mean is the same everywhere
        return pd.DataFrame(columns=columns)
    rows = []
    for value, vector in list(zip(values, vectors.T, strict=True))[::-1]:
        group, cosine = nearest_group(vector, coordinates.group_directions, coordinates.groups)
        exponents = vector / emulated.spans
        main = int(np.argmax(np.abs(vector)))
        near = group is not None and cosine < 0.0
        scaled = exponents / abs(exponents[main]) * (-1.0 if near else np.sign(vector[main]) * 1.0)
        if group is not None:
            power = group.powers.get(coordinates.names[main], 1.0)
            scaled = scaled * np.sign(scaled[main] * power)
        symbol = "" if group is None else group.symbol
        rows.append([value, value / values.sum(), *scaled, symbol, abs(cosine)])
    return pd.DataFrame(rows, columns=columns)


def nearest_group(vector: Floats, along: Floats, groups: list[Group]) -> tuple[Group | None, float]:
    """Return the group whose direction is nearest to a vector, if any is near, and the cosine.

    Parameters
    ----------
    vector
        Unit vector in units of the box, shape (d,).
    along
        Direction of each group, shape (g, d).
    groups
    """
    best, cosine = None, 0.0
    for group, direction in zip(groups, along, strict=True):
        size = float(np.linalg.norm(direction))
        if np.sum(np.abs(direction) > MIN_COMPONENT * size) < 2:
            continue  # over the box it is as good as one variable alone
        found = float(vector @ direction) / size if size > 0.0 else 0.0
        if abs(found) > abs(cosine):
            best, cosine = group, found
    return (best, cosine) if abs(cosine) >= MIN_COSINE else (None, cosine)


def rounded(exponent: float) -> float:
    """Return an exponent rounded to a quarter or, where that is nearer, to a third."""
    quarter, third = round(4.0 * exponent) / 4.0, round(3.0 * exponent) / 3.0
    is_quarter = abs(quarter - exponent) <= abs(third - exponent) + QUARTER_PREFERENCE
    return quarter if is_quarter else third


def _slopes(emulated: EmulatedSet, points: SetPoints) -> Floats:
    """Return slopes along each variable's logarithm at members, in units of the box, (n, d)."""
    coordinates = emulated.coordinates
    own = coordinates.own(points.even_members(SLOPE_MEMBERS))
    columns = []
    for i in range(own.shape[1]):
        ends = []
        widths = np.zeros(len(own))
        for sign in (1.0, -1.0):
            moved = own.copy()
            moved[:, i] = np.clip(moved[:, i] + sign * SLOPE_STEP, 0.0, 1.0)
            widths += np.abs(moved[:, i] - own[:, i])
            ends.append(emulated.mean_only(coordinates.strings(moved)))
        columns.append((ends[0] - ends[1]) / widths[:, None] / emulated.criterion.scales)
    # One row for each member and each quantity that is compared.
    return np.stack(columns, axis=-1).reshape(-1, own.shape[1])
