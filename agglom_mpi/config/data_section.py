"""Section `data`: what was measured, when, and with which error.

An entry gives one number with its error, or the file of a size distribution or of impacts, which
`measurements.files` reads. The identity of a campaign has its numbers, so that a stored campaign
needs no file.
"""

from collections.abc import Collection, Container, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, Self

import numpy as np

from agglom_mpi.declaration.components import In, Whole
from agglom_mpi.declaration.declared import (
    Declared,
    FieldError,
    FieldPath,
    Line,
    Meaning,
    Reads,
    raise_field_errors,
    read_value,
)
from agglom_mpi.declaration.reading import NamedFiles, Reading
from agglom_mpi.declaration.units import has_offset, quoted, to_si, unit_in
from agglom_mpi.formatting import in_unit, pluralise, value_with_prefix
from agglom_mpi.measurements.datum import Datum, datum_name
from agglom_mpi.measurements.files.campaign_files import CURVE_NUMBERS
from agglom_mpi.measurements.files.impact_file import MeasuredImpacts
from agglom_mpi.measurements.files.size_columns import CurveKeys
from agglom_mpi.measurements.files.size_curve import ShareWeight, SizeCurve
from agglom_mpi.measurements.quantities import QUANTITIES, MeasuredQuantity

if TYPE_CHECKING:
    QuantityName = str
else:
    QuantityName = Literal[tuple(QUANTITIES)]

PERCENT: Final = ("%", "percent")
"""Units of an error relative to its value."""
_OF_SIZES: Final = ("column", "unit", "counted")
_OF_FILES: Final = ("file", "headings", *_OF_SIZES)
"""Keys of an entry with a file; some are for sizes alone."""


def _read_number(value: Any, reading: Reading) -> float | None:
    """Return the value of a quantity in its SI unit; None of one that has none."""
    kind = QUANTITIES.get(reading.earlier.get("quantity", ""))
    if kind is None or kind.has_file:
        return None
    number = _positive(to_si(value, kind.unit), value, kind.unit)
    if number > kind.most:
        raise ValueError(f"is {quoted(value)}; must be at most {kind.most:g}")
    return number


def _read_error(value: Any, reading: Reading) -> float | None:
    """Return the error of a quantity in its SI unit; None of an unknown quantity."""
    kind = QUANTITIES.get(reading.earlier.get("quantity", ""))
    if kind is None:
        return None
    unit, given = kind.unit, unit_in(value)
    if given in PERCENT and unit != "1":
        # The quantity has a unit, so that a percentage can be nothing but relative.
        number = to_si(value, "1") * (reading.earlier.get("value") or 1.0)
    else:
        number = to_si(value, unit)
    if given and has_offset(given):
        raise ValueError(f"is {quoted(value)}; a difference of temperatures must be in K")
    if _positive(number, value, unit) >= 1.0 and kind.has_file:
        raise ValueError(f"is {quoted(value)}; the error of {kind.name} must be less than 100 %")
    return number


def _positive(number: float, value: Any, unit: str) -> float:
    """Return a number; raise a ValueError that quotes the value unless it is positive."""
    if not number > 0.0:
        raise ValueError(f"is {quoted(value)}; must be greater than {in_unit('0', unit)}")
    return number


class DatumEntry(Declared):
    """One measurement: a number with its error, or a file of sizes or of impacts.

    Attributes
    ----------
    quantity
        What was measured. `d43` and `d32` are mean diameters by volume and by surface, `spread` is
        the standard deviation of the diameters over their mean, `particles_left` a share of the
        grains at the start, `temperature` the mean by mass. `restitution` is that of single
        impacts, which the laws of the scene give without samples.
    value
        Measured value, with a unit or in SI units; of every quantity without a file.
    error
        Standard error of the value, also in percent of a value that has a unit; of a file that of
        each share, of each value of a cumulative curve, or of each coefficient, if it has no column
        of errors.
    weight
        What a particle counts by. Quantities without a weight take none.
    time
        Time of the measurement from the start of a sample; without it the end.
    file
        Name of the file, beside the campaign file: a cumulative curve, a histogram, or a list of
        diameters, under headings with units such as `sieve size (mm)` and `passing (%)`; or impacts
        under `speed (m/s)`, `radius (mm)` and `coefficient`. `radius 2 (mm)` of the other sphere
        may be `wall`, and `temperature (K)` replaces that of the string.
    column
        Heading of the column to read, where a file has several amounts or sizes.
    unit
        Unit of the sizes, where their heading has none.
    headings
        Known headings in place of those of the file: `{finer wt: passing (%)}`.
    counted
        Number of grains that were counted for the shares in the file, in place of `error`. Columns
        of counts and lists of diameters count themselves.
    """

    SUPPLIED: ClassVar[dict[str, str]] = {
        "weight": "as in the file, else mass for sizes, d10, d50, d90, number for means",
        "time": "the end",
    }
    """Texts on defaults."""

    quantity: Annotated[QuantityName, Meaning(f"allowed: {', '.join(QUANTITIES)}")]
    value: Annotated[float | None, Reads(_read_number, in_context=True)] = None
    error: Annotated[float | None, Reads(_read_error, in_context=True)] = None
    weight: ShareWeight | None = None
    time: Annotated[float | None, In("s", above=0)] = None
    file: Line | None = None
    column: Line = ""
    unit: Line = ""
    headings: dict[Line, Line] | None = None
    counted: Annotated[int, Whole(at_least=10)] | None = None
    _curve: SizeCurve | None = None
    _impacts: MeasuredImpacts | None = None
    _correlations: tuple[tuple[int, float], ...] = ()

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield keys that the quantity lacks, or does not have."""
        kind, unit = self.kind, self.kind.unit
        left_out = {"value"} if kind.has_file else {*_OF_FILES}
        left_out |= {"time", *_OF_SIZES} if kind.is_exact else set()
        left_out |= set() if kind.has_weight else {"weight"}
        for key in sorted(left_out & self.model_fields_set):
            weighted = ", ".join(name for name, each in QUANTITIES.items() if each.has_weight)
            belongs = f", and belongs to {weighted}" * (key == "weight")
            value = quoted(getattr(self, key))
            yield (key,), f"is {value}; must be left out of {self.quantity}{belongs}"
        number = "a number" if unit == "1" else f"a number in {unit}, or a text with a unit"
        for key in ("file",) if kind.has_file else ("value", "error"):
            if getattr(self, key) is None:
                like = f"like '{self.quantity}.csv'" if kind.has_file else number
                yield (key,), f"is missing; {like}"

    @property
    def kind(self) -> MeasuredQuantity:
        """The quantity with its unit and limits."""
        return QUANTITIES[self.quantity]

    def with_read(self, files: NamedFiles, place: int) -> Self:
        """Return the entry number `place` with what its file holds; raises as `NamedFiles` do."""
        stated = self.weight, self.column, self.unit, self.error, self.counted
        keys = CurveKeys(*stated, self.headings or {})
        if self.kind.is_exact:
            return self._with("_impacts", files.impacts(place, self.file or "", keys))
        return self._with("_curve", files.curve(place, self.file or "", keys))

    def with_correlations(self, correlations: Mapping[int, float]) -> Self:
        """Return the entry with the correlations with earlier entries, by their places."""
        stated = tuple((place, value) for place, value in sorted(correlations.items()) if value)
        return self._with("_correlations", stated)

    def _with(self, key: str, content: object) -> Self:
        copy = self.model_copy()
        copy.__dict__[key] = content
        return copy

    @property
    def used_weight(self) -> ShareWeight:
        """Weight of the quantity; by number if it has none."""
        if self._curve is not None:
            return self._curve.weight
        return self.weight or self.kind.usual_weight

    @property
    def label(self) -> str:
        """Name of the datum for people, as `sizes by mass at 2 ms`."""
        if self.kind.is_exact:
            return f"{self.quantity} in {self.file}"
        return datum_name(self.quantity, self.used_weight, self.time)

    @property
    def summary(self) -> str:
        """One line on the datum and its numbers."""
        if self._impacts is not None:
            ends = [f"{end(self._impacts.speeds):.3g}" for end in (min, max)]
            count = pluralise(len(self._impacts.speeds), "impact")
            return f"{self.label}: {count} at {' to '.join(dict.fromkeys(ends))} m/s"
        if self._curve is None:
            value, error = (_shown(each, self.kind.unit) for each in (self.value, self.error))
            with_others = [f"{r:g} with data.{place}" for place, r in self._correlations]
            more = f", correlation {', '.join(with_others)}" if with_others else ""
            return f"{self.label}: {value} ± {error}{more}"
        low, high = self._curve.edges[0], self._curve.edges[-1]
        lower = _length("below", self._curve.edges[1]) if low == 0.0 else _length("", low)
        upper = _length("above", self._curve.edges[-2]) if high == np.inf else _length("", high)
        return f"{self.label}: {len(self._curve.shares)} classes, {lower} to {upper}, {self.file}"

    def build(self, earlier: Sequence[Datum] = ()) -> Datum:
        """Return the datum in SI units; `earlier` ones are those that it may correlate with."""
        if self._impacts is not None:
            values, errors = map(np.array, self._impacts[-2:])
            conditions = self._impacts.conditions
            covariance = np.diag(np.square(errors))
            return Datum(self.quantity, values, covariance, name=self.label, impacts=conditions)
        if self._curve is None:
            value, error = float(self.value or 0.0), float(self.error or 0.0)
            datum = Datum.of_value(
                self.quantity, value, error, self.used_weight, self.time, self.label
            )
            pairs = tuple((earlier[place], r) for place, r in self._correlations)
            return replace(datum, correlations=pairs)
        return Datum(
            quantity=self.quantity,
            values=np.array(self._curve.shares),
            covariance=self._curve.covariance,
            weight=self.used_weight,
            time=self.time,
            edges=np.array(self._curve.edges),
            name=self.label,
        )

    def entries(self) -> dict[str, Any]:
        """Return the datum as plain values; the numbers of a file as texts, without its name."""
        found: dict[str, Any] = {"quantity": self.quantity}
        if self.kind.has_weight:
            found["weight"] = self.used_weight
        if self.time is not None:
            found["time"] = self.time
        if self._impacts is not None:
            return found | _texts(self._impacts, MeasuredImpacts._fields)
        if self._curve is None:
            correlations = {str(place): r for place, r in self._correlations}
            found |= {"correlations": correlations} if correlations else {}
            return {**found, "value": self.value, "error": self.error}
        numbers = _texts(self._curve, CURVE_NUMBERS)
        return {**found, "errors_of": self._curve.errors_of, **numbers}


def _texts(of: Any, names: Sequence[str]) -> dict[str, str]:
    return {name: " ".join(map(repr, getattr(of, name))) for name in names}


def read_data(value: Any, reading: Reading) -> tuple[DatumEntry, ...]:
    """Return the entries of the section with what their files hold; raise a FieldError."""
    found, problems = [], list[tuple[FieldPath, str]]()
    data: tuple[DatumEntry, ...] = read_value(value, tuple[DatumEntry, ...], (), reading)
    for place, entry in enumerate(data):
        try:
            found.append(entry if entry.file is None else entry.with_read(reading.files, place))
        except FieldError as error:
            problems += [((place, *path), message) for path, message in error.problems]
        except ValueError as error:
            problems.append(((place, "file"), str(error)))
    raise_field_errors(problems)
    return tuple(found)


def built_data(entries: Sequence[DatumEntry], experiment: str = "") -> tuple[Datum, ...]:
    """Return the data of a section, or of an experiment, in SI units."""
    found: list[Datum] = []
    for entry in entries:
        datum = entry.build(found)
        if experiment:
            datum = replace(datum, experiment=experiment, name=f"{experiment}: {datum.name}")
        found.append(datum)
    return tuple(found)


def fixed_end(end: float | str, varied: Container[str]) -> float | None:
    """Return the end of all samples in s; None where it differs between strings.

    `end` is that of the scene, and `varied` the numbers of the scene that are variables.
    """
    return None if isinstance(end, str) or "end_time" in varied else float(end)


def late(time: float, end: float | None) -> str:
    """Return why not all samples reach a time; `end` as for `impossible_data`; empty if they do."""
    own = value_with_prefix(time, "s")
    if end is None:
        return f"is {own}; needs a fixed end_time of the scene, which every sample reaches"
    last = value_with_prefix(end, "s")
    return f"is {own}; must be at most the end_time of the scene, {last}" if time > end else ""


def impossible_data(
    data: tuple[DatumEntry, ...], end: float | None, has_heat: bool, always_bonds: str | None
) -> Iterator[tuple[FieldPath, str]]:
    """Yield data that a scene cannot have.

    `end` is the fixed end of its samples in s, None where it differs between strings.
    `always_bonds` is why nothing bounces; None where grains may.
    """
    for i, entry in enumerate(data):
        if entry.time is not None and (message := late(entry.time, end)):
            yield (i, "time"), message
        if entry.kind.is_exact and always_bonds is not None:
            message = f"is {entry.quantity!r}, but with {always_bonds} nothing bounces"
            yield (i, "quantity"), f"{message}; the scene must have a restitution"
        if entry.kind.needs_heat and not has_heat:
            message = f"is {entry.quantity!r}, but heating is 'none'; the scene must have heating"
            yield (i, "quantity"), message


TOLD_APART: Final = 0.01
"""Minimum relative difference of a number from that of a size curve, unless it is the same."""


def repeated_data(
    data: tuple[DatumEntry, ...], end: float | str, stated: Collection[tuple[int, int]]
) -> Iterator[tuple[FieldPath, str]]:
    """Yield data that stand twice, with the same numbers, under another name or in a curve.

    Data of one name with different numbers are two measurements, and so are pairs of `stated`
    correlation.
    """
    for i, entry in enumerate(data):
        for j, other in enumerate(data[:i]):
            times = {None if each.time == end else each.time for each in (entry, other)}
            if len(times) == 1 and (j, i) not in stated and _are_one(entry, other):
                message = f"is the same as data.{j}, {other.label}; each must stand once, or"
                yield (i,), f"{message} `correlations` must have both, of two measurements"
                break


def _are_one(entry: DatumEntry, other: DatumEntry) -> bool:
    """Return whether two data of one time are the same, or a curve and one of its diameters."""
    names = [each.kind.one_name(each.used_weight) for each in (entry, other)]
    if names[0] == names[1]:
        return entry.label != other.label or entry.entries() == other.entries()
    for (curve, number), name in zip(((entry, other), (other, entry)), names[::-1], strict=True):
        if curve._curve is not None and number.value is not None:
            diameters = curve._curve.diameters().items()
            own = {QUANTITIES[key].one_name(by): ends for (key, by), ends in diameters}
            low, high = own.get(name, (np.inf, -np.inf))
            value = number.value / number.kind.factor
            return low * (1.0 - TOLD_APART) < value < high * (1.0 + TOLD_APART)
    return False


def _length(word: str, length: float) -> str:
    return f"{word} {value_with_prefix(length, 'm')}".strip()


def _shown(number: float | None, unit: str) -> str:
    """Return a number with its unit; lengths with a prefix."""
    number = 0.0 if number is None else number
    return value_with_prefix(number, unit) if unit == "m" else in_unit(f"{number:g}", unit)
