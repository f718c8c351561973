"""Data that may be measured next: which quantities at which times, and with which error."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.config.arguments import read_amount
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.declaration.units import has_offset, to_si, unit_in
from agglom_mpi.formatting import in_unit
from agglom_mpi.measurements.datum import Datum, datum_name
from agglom_mpi.measurements.layout import Layouts, layout_of
from agglom_mpi.measurements.quantities import QUANTITIES, AssumedError

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

REPEATED_ERROR: Final = 0.5
"""Standard error of the repetition of a datum relative to that of the datum."""


def quantities_to_measure(
    times: Sequence[float | None], measured: Sequence[Datum], has_heat: bool
) -> list[Datum]:
    """Return the data of one number that are not measured yet, with values and errors of 1.

    Parameters
    ----------
    times
        Times of the censuses in s; None: the end.
    measured
        The data that there are.
    has_heat
        Whether the particles of the scene have a temperature that changes.
    """
    known = {(*datum.kind.one_name(datum.weight), datum.time) for datum in measured}
    return [
        Datum.of_value(quantity, 1.0, 1.0, weight, time, datum_name(quantity, weight, time))
        for time in times
        for quantity, kind in QUANTITIES.items()
        for weight in kind.next_weights
        if (quantity, weight, time) not in known and (has_heat or not kind.needs_heat)
    ]


def new_data(campaign: "Campaign", layout: Layouts, measured: Sequence[Datum]) -> list[Datum]:
    """Return the data of one number that are not measured yet, of all experiments of a campaign.

    Each is at the times of its censuses, also of those without data so far.
    """
    scenes = {each.name: each.campaign.scene for each in campaign.experiments}
    found = list[Datum]()
    for name, scene in (scenes or {"": campaign.scene}).items():
        times = [None if time == math.inf else time for time in layout_of(layout, name).times]
        known = [datum for datum in measured if datum.experiment == name]
        for new in quantities_to_measure(times, known, not scene.heating.is_absent):
            found.append(replace(new, experiment=name, name=f"{name}: {new.name}") if name else new)
    return found


def repeated(datum: Datum) -> Datum:
    """Return a repetition of a datum with half of its error."""
    return replace(
        datum, covariance=REPEATED_ERROR**2 * datum.covariance, name=f"{datum.name}, again"
    )


def assumed_error(
    quantity: str, measured: Sequence[Datum], errors: Mapping[str, AssumedError]
) -> AssumedError:
    """Return the error that a measurement of a quantity is assumed to have.

    It is the stated one, or else the median of the errors of the data of the same kind: relative
    ones, but absolute ones of temperatures. Diameters and radii are of one kind; every other
    quantity is of its own.
    """
    if quantity in errors:
        return errors[quantity]
    asked = QUANTITIES[quantity]
    same = [
        datum
        for datum in measured
        if len(datum.values) == 1 and datum.kind.errors_like == asked.errors_like
    ]
    if not same:
        return asked.assumed_error
    is_relative = asked.assumed_error.is_relative
    found = [float(datum.standard_errors[0]) for datum in same]
    if is_relative:
        found = [error / float(d.values[0]) for error, d in zip(found, same, strict=True)]
    return AssumedError(float(np.median(found)), is_relative)


def read_errors(given: Mapping[str, Any] | None) -> dict[str, AssumedError]:
    """Return the stated errors of quantities by name.

    Parameters
    ----------
    given
        An error for some quantities: a percentage of the value, such as `"3%"`, or a number in SI
        units or a text with a unit, such as `"5 um"`.

    Raises
    ------
    ValueError
        If there is no such quantity of one number, or the error is impossible; with the name of
        the quantity first.
    """
    names = [name for name, kind in QUANTITIES.items() if kind.next_weights]
    found = {}
    for name, value in (given or {}).items():
        if name not in names:
            raise ValueError(f"{name}: is no quantity to measure; {suggestion(name, names)}")
        try:
            found[name] = _read_error(value, QUANTITIES[name].unit)
        except ValueError as problem:
            raise ValueError(f"{name}: {problem}") from None
    return found


def _read_error(value: Any, unit: str) -> AssumedError:
    if isinstance(value, str) and value.strip().endswith("%"):
        error = AssumedError(read_amount(value)[0], is_relative=True)
        rule = "between 0 % and 100 %"
        possible = 0.0 < error.value < 1.0
    else:
        given = unit_in(value)
        if given and has_offset(given):
            raise ValueError(f"is {value!r}; a difference of temperatures must be in K")
        error = AssumedError(to_si(value, unit), is_relative=False)
        rule = f"greater than {in_unit('0', unit)}"
        possible = error.value > 0.0
    if not possible:
        raise ValueError(f"is {value!r}; must be {rule}")
    return error
