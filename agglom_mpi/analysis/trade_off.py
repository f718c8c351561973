"""Two numbers of the best strings of several campaign files, and which of them are dominated.

Campaigns of one question with different constraints, such as `power < 10 W`, trace a Pareto front:
the best objective that each power allows.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from rich.console import Group, RenderableType

from agglom_mpi.analysis.derived import derived_columns, recorded_box, values_of
from agglom_mpi.analysis.estimates import completed_rows
from agglom_mpi.analysis.quantity_means import quantity_means
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.shown_units import column_of
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.display.table import Column, Table
from agglom_mpi.errors import UserError
from agglom_mpi.statistics import mean_of

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

OBJECTIVE, GROWTH = "objective", "mean_radius_ratio"
"""Names of the measured numbers that every file has."""
RESOLVED: Final = 2.0
"""A difference is resolved from this number of its standard errors on."""
FRONT, UNRESOLVED, DOMINATED = "front", "within errors", "dominated"
"""What a point is: dominated by no other, by none beyond the errors, or beyond them."""
NOTES: Final = (
    f"± is a standard error; dominated: another is better by {RESOLVED:g} or more on both axes",
)
SEARCHED: Final = "as searched: no fresh samples; the samples that a string was chosen by favour it"


class TradeOffError(UserError, ValueError):
    """A front that cannot be drawn, with the reason."""


class TradeOffAxis(NamedTuple):
    """A number that strings are compared by; the higher the better if it is `maximised`."""

    name: str
    unit: str
    maximised: bool


Number = tuple[float, float]
"""A value in SI units, and its standard error: 0 where it follows from the variables alone."""


def trade_off(
    files: "Sequence[CampaignData]", axes: tuple[TradeOffAxis, TradeOffAxis]
) -> RenderableType:
    """Return the table of the best strings of files on two axes, in the units of the first file.

    Raises
    ------
    TradeOffError
        If a file has no such number, or no string with a result.
    """
    best = [_best(file) for file in files]
    points = [
        [_measured(file, *string, axis.name) for axis in axes]
        for file, string in zip(files, best, strict=True)
    ]
    columns = [Column("file"), Column("string", format="d")]
    for axis, numbers in zip(axes, zip(*points, strict=True), strict=True):
        largest = max(abs(value) for value, _ in numbers)
        sense = "maximised" if axis.maximised else "minimised"
        column = column_of(files[0].campaign_text, axis.name, axis.unit, largest, sense)
        columns.append(column._replace(format=".4g"))
    rows: list[dict[str, Any]] = []
    found = zip(files, best, points, verdicts(points, axes), strict=True)
    for file, (string, fresh), point, verdict in found:
        name = str(file.path) if fresh else f"{file.path} (as searched)"
        rows.append({"file": name, "string": string, "verdict": verdict})
        for axis, (value, error) in zip(axes, point, strict=True):
            rows[-1][axis.name] = (value, error) if error > 0.0 else value
    table = Table([*columns, Column("verdict", "", text=True)], rows)
    return Group(table, *(NOTES if all(fresh for _, fresh in best) else [*NOTES, SEARCHED]))


def axis_of(files: "Sequence[CampaignData]", name: str, maximised: bool) -> TradeOffAxis:
    """Return the axis of a number that every file has.

    It is `objective`, `mean_radius_ratio`, a quantity of samples, a variable or a derived quantity.

    Raises
    ------
    TradeOffError
        If a file lacks it, or has it in another unit.
    """
    units = []
    for file in files:
        known = _known_units(file)
        if name not in known:
            raise TradeOffError(f"{file.path}: has no number {name!r}; {suggestion(name, known)}")
        units.append(known[name])
        if units[-1] != units[0]:
            raise TradeOffError(
                f"{file.path}: {name} is in {units[-1]}, and in {units[0]} in {files[0].path}"
            )
    return TradeOffAxis(name, units[0], maximised)


def _known_units(file: "CampaignData") -> dict[str, str]:
    """Return the units of all numbers that a string of a file has, by name."""
    units = {each.name: each.unit for each in recorded_box(file).variables if each.is_used}
    units |= {column.name: column.unit for column in derived_columns(file)}
    return units | {OBJECTIVE: "1", GROWTH: "1"} | dict(file.sizes.quantities)


def _best(file: "CampaignData") -> tuple[int, bool]:
    """Return the best string of a file, and whether it has fresh samples."""
    ranked = rank_strings(file)
    if not ranked.order:
        raise TradeOffError(f"{file.path}: no string has a result yet")
    string = ranked.order[0]
    return string, string in ranked.again


def _measured(file: "CampaignData", string: int, fresh: bool, name: str) -> Number:
    """Return a number of a string and its standard error, on fresh samples or those searched by."""
    if name == OBJECTIVE:
        ranked = rank_strings(file)
        if fresh:
            again = ranked.again[string]
            return again.objective, again.standard_error
        row = ranked.results[string]
        return float(row["objective"]), float(row["standard_error"])
    if name in file.sizes.quantities:
        mean = quantity_means(file, string)[name][int(fresh)]
        return mean.value, mean.error
    if name == GROWTH:
        mean = mean_of(completed_rows(file, string, fresh)[GROWTH])
        return mean.value, mean.error
    return float(values_of(file, [string], name)[0]), 0.0


def verdicts(points: Sequence[Sequence[Number]], axes: Sequence[TradeOffAxis]) -> list[str]:
    """Return what each point is: `FRONT`, `UNRESOLVED` or `DOMINATED`.

    A point dominates another that is no better on either axis, and worse on one. It does so beyond
    the errors if each difference is at least `RESOLVED` of its standard errors, by which a number
    without an error has to be no better.
    """
    found = []
    for i, point in enumerate(points):
        others = [other for j, other in enumerate(points) if j != i]
        if any(_dominates(other, point, axes, RESOLVED) for other in others):
            found.append(DOMINATED)
        elif any(_dominates(other, point, axes, 0.0) for other in others):
            found.append(UNRESOLVED)
        else:
            found.append(FRONT)
    return found


def _dominates(
    better: Sequence[Number],
    worse: Sequence[Number],
    axes: Sequence[TradeOffAxis],
    resolved: float,
) -> bool:
    """Return whether a point dominates another by some number of standard errors."""
    gains = []
    for axis, (value, error), (other, other_error) in zip(axes, better, worse, strict=True):
        gain = value - other if axis.maximised else other - value
        # An error that is nan, of a single sample, resolves nothing.
        both = math.hypot(error, other_error) if resolved else 0.0
        if not gain >= resolved * both:
            return False
        gains.append(gain)
    return max(gains) > 0.0
