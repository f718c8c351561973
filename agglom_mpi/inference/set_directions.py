"""Which variables decide whether a string is in a feasible set, and in which combinations."""

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.groups import Group

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.inference.feasible_set import FeasibleSet

Floats = NDArray[np.float64]

MEMBERS: Final = 300
"""Members at which the slopes are taken."""
STEP: Final = 0.02
"""Half of the step of a slope, in units of the box."""
FREE: Final = 0.8
"""Share of its range over which a free variable may be moved, on average, all others kept."""
LINES, PLACES = 150, 12
"""Members that are moved along each variable, and places that they are moved to."""
NEAR: Final = 0.95
"""Cosine from which a direction is near a group, in units of the box."""
LEAST_PART: Final = 0.1
"""Part of a variable in a group's direction, in units of the box, from which it counts."""
EDGE: Final = 0.03
"""Share of a range at its end that is looked at for members."""
TOUCHES: Final = 0.2
"""Density of the set there over its largest, from which it touches the edge."""
SLICES: Final = 20
"""Parts of a range in which the density is compared."""


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
        5 %, 50 % and 95 % of the set lies below.
    kept
        Share of its range over which a member may be moved, the others kept, and stay a member.
    free
        Whether that is `FREE` or more: the variable decides nothing, else it is decided, with
        others or alone.
    touches
        Edges of the box that the set touches: `lower`, `upper`; the set may go on there.
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


def variables(of: "FeasibleSet") -> list[SetVariable]:
    """Return the searched variables of a set, in their order; none if the set is empty."""
    points = of.points
    mass = points.probability * points.weights
    if of.empty or mass.sum() <= 0.0:
        return []
    kept = _kept_shares(of)
    space = of.campaign.variables.space()
    units = space.to_unit(points.strings)
    found = []
    for place, variable in enumerate(of.own):
        values = variable.values(points.strings)
        outer = values[points.probability >= 0.05]
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
                bool(kept[place] >= FREE),
                _touched(units[:, place], mass, place in _narrowed(of)),
            )
        )
    return found


def weighted_quantiles(
    values: Floats, weights: Floats, shares: tuple[float, ...]
) -> tuple[float, ...]:
    """Return the values below which these shares of the weights lie."""
    order = np.argsort(values)
    below = np.cumsum(weights[order]) / weights.sum()
    places = np.minimum(np.searchsorted(below, shares), len(values) - 1)
    return tuple(values[order][places].tolist())


def _narrowed(of: "FeasibleSet") -> list[int]:
    """Return the places of variables whose range was narrowed down on both sides."""
    inside = (of.points.lower > 0.0) & (of.points.upper < 1.0)
    return np.flatnonzero(inside).tolist()


def _touched(units: Floats, mass: Floats, inside: bool) -> tuple[str, ...]:
    """Return at which ends of a variable's range the set is about as dense as elsewhere."""
    if inside:
        return ()
    counts = np.bincount(np.minimum((units * SLICES).astype(np.int64), SLICES - 1), mass, SLICES)
    largest = counts.max() * SLICES
    ends = {"lower": units < EDGE, "upper": units > 1.0 - EDGE}
    return tuple(name for name, at in ends.items() if mass[at].sum() / EDGE > TOUCHES * largest)


def _kept_shares(of: "FeasibleSet") -> Floats:
    """Return over which share of its range each variable may be moved, on average, (d,)."""
    members = _some_members(of, LINES)
    space = of.campaign.variables.space()
    start = space.to_unit(members)
    here = of.probability_of(members).mean()
    places = (np.arange(PLACES) + 0.5) / PLACES
    shares = []
    for i in range(start.shape[1]):
        moved = np.repeat(start, PLACES, axis=0)
        moved[:, i] = np.tile(places, len(start))
        strings = space.from_unit(moved)
        allowed = of.campaign.allowed_strings(strings)
        there = of.probability_of(strings)[allowed]
        shares.append(min(1.0, float(there.mean() / here)) if len(there) and here > 0.0 else 0.0)
    return np.array(shares)


def _some_members(of: "FeasibleSet", count: int) -> Floats:
    """Return strings of the points, (count, 10), drawn by their probability."""
    mass = of.points.probability * of.points.weights
    places = (np.arange(count) + 0.5) / count
    chosen = np.searchsorted(np.cumsum(mass) / mass.sum(), places)
    return of.points.strings[np.minimum(chosen, len(mass) - 1)]


def directions(of: "FeasibleSet") -> "pd.DataFrame":
    """Return the active directions of a set (Constantine 2015); see `FeasibleSet.directions`."""
    import pandas as pd

    names, coordinates = list(of.names), of.coordinates
    columns = ["eigenvalue", "share", *names, "group", "cosine"]
    if of.empty or of.volume <= 0.0:
        return pd.DataFrame(columns=columns)
    slopes = _slopes(of)
    values, vectors = np.linalg.eigh(slopes.T @ slopes / len(slopes))
    if values.sum() <= 0.0:  # the emulated mean is the same everywhere
        return pd.DataFrame(columns=columns)
    rows = []
    for value, vector in list(zip(values, vectors.T, strict=True))[::-1]:
        group, cosine = nearest_group(vector, coordinates.group_directions, coordinates.groups)
        exponents = vector / of.spans
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
    """Return the group whose direction is nearest to a vector, if any is `NEAR`, and the cosine.

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
        if np.sum(np.abs(direction) > LEAST_PART * size) < 2:
            continue  # over the box it is as good as one variable alone
        found = float(vector @ direction) / size if size > 0.0 else 0.0
        if abs(found) > abs(cosine):
            best, cosine = group, found
    return (best, cosine) if abs(cosine) >= NEAR else (None, cosine)


def rounded(exponent: float) -> float:
    """Return an exponent rounded to a quarter or, where that is nearer, to a third."""
    quarter, third = round(4.0 * exponent) / 4.0, round(3.0 * exponent) / 3.0
    return quarter if abs(quarter - exponent) <= abs(third - exponent) + 0.02 else third


def _slopes(of: "FeasibleSet") -> Floats:
    """Return slopes along each variable's logarithm at members, in units of the box, (n, d)."""
    coordinates = of.coordinates
    own = coordinates.own(_some_members(of, MEMBERS))
    scale = _scales(of)
    columns = []
    for i in range(own.shape[1]):
        ends = []
        widths = np.zeros(len(own))
        for sign in (1.0, -1.0):
            moved = own.copy()
            moved[:, i] = np.clip(moved[:, i] + sign * STEP, 0.0, 1.0)
            widths += np.abs(moved[:, i] - own[:, i])
            ends.append(of.emulator.mean_only(coordinates.of_strings(coordinates.strings(moved))))
        columns.append((ends[0] - ends[1]) / widths[:, None] / scale)
    # One row for each member and each quantity that is compared.
    return np.stack(columns, axis=-1).reshape(-1, own.shape[1])


def _scales(of: "FeasibleSet") -> Floats:
    """Return by what several quantities are divided to be compared, (q,)."""
    half = getattr(of.criterion, "half_widths", None)
    return np.ones(1) if half is None else np.asarray(half)
