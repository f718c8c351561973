"""Data that may be measured next: which quantities at which times, and with which error."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.config.arguments import read_amount
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.declaration.units import has_offset, to_si, unit_in
from agglom_mpi.formatting import in_unit, value_with_prefix
from agglom_mpi.measurements.datum import PARTICLE_WEIGHTS, QUANTITIES, Datum, datum_name, one_name

MEASURABLE: Final = tuple(
    (quantity, weight)
    for quantity, weights in {
        "d10": PARTICLE_WEIGHTS,
        "d50": PARTICLE_WEIGHTS,
        "d90": PARTICLE_WEIGHTS,
        "d43": ("number",),
        "d32": ("number",),
        # The means by area and mass are d32 and d43, and a mean radius is half a diameter.
        "mean_diameter": ("number",),
        "spread": ("number",),
        "particles_left": ("number",),
        "largest_mass_fraction": ("number",),
        "temperature": ("number",),
    }.items()
    for weight in weights
)
"""Quantities of one number and their weights, each once: none is a function of another one."""

ASSUMED_RELATIVE_ERROR: Final = 0.05
"""Standard error relative to the predicted value, of quantities like none of the data."""
ASSUMED_TEMPERATURE_ERROR: Final = 1.0
"""Standard error of a temperature in K, where the data have none."""
REPEATED_ERROR: Final = 0.5
"""Standard error of the repetition of a datum relative to that of the datum."""


class AssumedError(NamedTuple):
    """Standard error of a measurement: absolute in SI units, or relative to what is measured."""

    value: float
    is_relative: bool

    def at(self, predicted: float) -> float:
        """Return the standard error of a measurement of about the predicted value."""
        return self.value * abs(predicted) if self.is_relative else self.value

    def text(self, unit: str) -> str:
        """Return the error for people: `5 %` or `10 µm`."""
        if self.is_relative:
            return f"{100.0 * self.value:.3g} %"
        if unit == "m":
            return value_with_prefix(self.value, unit)
        return in_unit(f"{self.value:.3g}", unit)


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
    known = {(*one_name(datum.quantity, datum.weight), datum.time) for datum in measured}
    return [
        Datum.of_value(quantity, 1.0, 1.0, weight, time, datum_name(quantity, weight, time))
        for time in times
        for quantity, weight in MEASURABLE
        if (quantity, weight, time) not in known and (has_heat or quantity != "temperature")
    ]


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
    kind = _kind(quantity)
    same = [d for d in measured if len(d.values) == 1 and _kind(d.quantity) == kind]
    absolute = [math.sqrt(float(datum.covariance[0, 0])) for datum in same]
    if kind == "temperature":
        value = float(np.median(absolute)) if absolute else ASSUMED_TEMPERATURE_ERROR
        return AssumedError(value, is_relative=False)
    relative = [error / float(d.values[0]) for error, d in zip(absolute, same, strict=True)]
    value = float(np.median(relative)) if relative else ASSUMED_RELATIVE_ERROR
    return AssumedError(value, is_relative=True)


def _kind(quantity: str) -> str:
    return "length" if QUANTITIES[quantity].unit == "m" else quantity


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
    names = list(dict.fromkeys(quantity for quantity, _ in MEASURABLE))
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
        error = AssumedError(read_amount(value).value, is_relative=True)
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
