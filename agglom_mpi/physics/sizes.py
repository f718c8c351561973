"""Laws of the grains' sizes at the start, as a scene names them by `sizes`."""

import math
from collections.abc import Iterator
from contextlib import suppress
from functools import cached_property
from typing import Annotated, Any, ClassVar, Final, Literal, TypeAlias

import numpy as np

from agglom_mpi.declaration.components import (
    Component,
    In,
    UnknownComponentError,
    Whole,
    class_named,
    unit_of,
)
from agglom_mpi.declaration.declared import LATER, FieldPath, Line, Reads
from agglom_mpi.declaration.needed import needed
from agglom_mpi.declaration.reading import PLAIN, Reading, names_own
from agglom_mpi.declaration.units import quoted, to_si
from agglom_mpi.formatting import pluralise, value_with_prefix
from agglom_mpi.physics.size_distributions import (
    ListedDistribution,
    LognormalDistribution,
    SizeLaw,
    UniformDistribution,
    VolumeUniformDistribution,
)

LENGTH_KEYS: Final = ("median", "smallest", "largest")
"""Keys of which one in a law says that it is of lengths, and so fixes the size of the grains."""

Length: TypeAlias = Annotated[float | None, In("m", above=0)]
"""Metres; None where it is not given."""

Basis: TypeAlias = Annotated[Literal["number", "volume"], LATER]
"""Whether a distribution counts grains or their volume, as sieves and laser diffraction do."""

_BY: Final[dict[str, str]] = {"number": "", "volume": " by volume"}
"""Words for each basis in the summary of a law."""


class Sizes(Component):
    """Law of the diameters of the grains.

    The mean is by number on either basis, as everywhere else in a scene.

    Attributes
    ----------
    reads_file
        Whether diameters are read from a file beside the campaign.
    """

    found_in = "agglom_mpi.physics"
    reads_file: ClassVar[bool] = False

    @classmethod
    def as_mapping(cls, entry: Any) -> Any:
        """Return an entry as a mapping; `{file: …}` is the law `file`, with an error `curve`."""
        if isinstance(entry, dict) and "file" in entry and cls.named_by not in entry:
            law = CurveSizes if {"error", "counted"} & set(entry) else FileSizes
            return {cls.named_by: law.names()[0], **entry}
        return super().as_mapping(entry)

    @property
    @needed
    def mean_diameter(self) -> float | None:
        """Mean diameter in m; None where the law is of sizes relative to the mean."""
        raise NotImplementedError

    @cached_property
    def size_law(self) -> SizeLaw:
        """The distribution of radii; one object, which calculates its moments once."""
        return self.build()

    def errors_of_means(self) -> tuple[float, ...]:
        """Relative errors of the means by number and volume of what was measured; none of a law."""
        return ()

    @needed
    def build(self) -> SizeLaw:
        """Return the distribution of radii over their mean."""
        raise NotImplementedError


class LognormalSizes(Sizes):
    """Lognormal diameters; `spread` is the geometric standard deviation, the same on each basis.

    A `median` by volume is exp(3 ln² spread) times that by number (Hatch and Choate).

    Attributes
    ----------
    spread
        Geometric standard deviation of the diameters.
    median
        Diameter that half of the grains are below; without it the scene says the mean size.
    basis
        Whether the median is that of their numbers or of their volume.
    """

    law: Literal["lognormal"] = "lognormal"
    example: ClassVar[str] = "{law: lognormal, spread: 1.3}"
    spread: Annotated[float, In("1", above=1, at_most=3, meaning="like 1.3")]
    median: Length = None
    basis: Basis = "number"

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield a basis without a median."""
        if self.basis == "volume" and self.median is None:
            message = (
                "is 'volume', which says what a median is of; give median, or leave it out, as the "
                "spread is the same by number and by volume"
            )
            yield ("basis",), message

    @property
    def mean_diameter(self) -> float | None:
        """Mean diameter in m: median times exp(ln² spread/2), exp(−5 ln² spread/2) by volume."""
        if self.median is None:
            return None
        power = -2.5 if self.basis == "volume" else 0.5
        return self.median * math.exp(power * math.log(self.spread) ** 2)

    @property
    def summary(self) -> str:
        """One line on the law."""
        median = "" if self.median is None else f", median {value_with_prefix(self.median, 'm')}"
        return f"lognormal{median}{_BY[self.basis]}, geometric standard deviation {self.spread:g}"

    def build(self) -> SizeLaw:
        """Return the distribution of radii over their mean."""
        return LognormalDistribution(math.log(self.spread))


class UniformSizes(Sizes):
    """Diameters uniform from `smallest` to `largest`, or with their `ratio` about the mean.

    Attributes
    ----------
    smallest, largest
        Ends of the diameters.
    ratio
        Largest diameter over the smallest, in place of both; the scene says the mean size.
    basis
        Whether each diameter is as likely by number, or has as much volume.
    """

    law: Literal["uniform"] = "uniform"
    example: ClassVar[str] = "{law: uniform, ratio: 2}"
    smallest: Length = None
    largest: Length = None
    ratio: Annotated[float | None, In("1", above=1, at_most=10)] = None
    basis: Basis = "number"

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield ends that are missing, doubled, or in the wrong order; the first that is wrong."""
        if self.smallest is None and self.largest is None and self.ratio is None:
            yield (
                ("smallest",),
                "is missing; give smallest and largest, or their ratio like 1.5",
            )
        elif self.ratio is not None:
            if self.smallest is not None or self.largest is not None:
                yield (
                    ("ratio",),
                    "is given beside lengths; give smallest and largest, or their ratio",
                )
        elif self.smallest is None or self.largest is None:
            missing = "smallest" if self.smallest is None else "largest"
            yield (missing,), "is missing; a diameter like '50 um'"
        elif not self.smallest < self.largest:
            message = f"is {self.largest:g} m; must be greater than smallest, {self.smallest:g} m"
            yield ("largest",), message
        elif self.largest > 10.0 * self.smallest:
            yield ("largest",), f"is {self.largest:g} m; must be at most 10 times smallest"

    @property
    def _smallest(self) -> float:
        return 1.0 if self.smallest is None else self.smallest

    @property
    def _largest(self) -> float:
        return (self.ratio or 1.0) if self.largest is None else self.largest

    @property
    def _mean(self) -> float:
        """Mean of the ends, the harmonic one where sizes are uniform by volume."""
        total = self._smallest + self._largest
        if self.basis == "volume":
            return 2.0 * self._smallest * self._largest / total
        return 0.5 * total

    @property
    def mean_diameter(self) -> float | None:
        """Mean diameter in m."""
        return None if self.smallest is None else self._mean

    @property
    def summary(self) -> str:
        """One line on the law."""
        if self.ratio is not None:
            return f"uniform{_BY[self.basis]}, the largest {self.ratio:g} times the smallest"
        ends = (value_with_prefix(end, "m") for end in (self._smallest, self._largest))
        return f"uniform{_BY[self.basis]}, {' to '.join(ends)}"

    def build(self) -> SizeLaw:
        """Return the distribution of radii over their mean."""
        law = VolumeUniformDistribution if self.basis == "volume" else UniformDistribution
        return law(self._smallest / self._mean, self._largest / self._mean)


class FileSizes(Sizes):
    """Diameters drawn from the rows of a file; the campaign stores its contents.

    `diameters` are in m, or relative to each other where the file gives no unit. All rows are as
    likely by number, or stand for the same volume of grains.

    Attributes
    ----------
    file
        Name of the file, beside the campaign file: one diameter a row, or a column of a table.
    basis
        Whether each row stands for as many grains, or for as much volume.
    """

    reads_file = True
    not_in_files: ClassVar[tuple[str, ...]] = ("diameters", "absolute")
    law: Literal["file"] = "file"
    example: ClassVar[str] = "{file: diameters.csv}"
    file: Line
    diameters: tuple[float, ...] = ()
    absolute: bool = False
    basis: Basis = "number"

    @cached_property
    def own_mean(self) -> float:
        """Mean diameter by number, in the unit of `diameters`."""
        if self.basis == "volume":  # a row has d⁻³ of the grains
            numbers = (np.array(self.diameters) / min(self.diameters)) ** -3
            return math.fsum(numbers * self.diameters) / math.fsum(numbers)
        return math.fsum(self.diameters) / len(self.diameters)

    @property
    def mean_diameter(self) -> float | None:
        """Mean diameter in m."""
        return self.own_mean if self.absolute else None

    @property
    def summary(self) -> str:
        """One line on the law."""
        rows = pluralise(len(self.diameters), "row")
        alike = ", each with the same volume of grains" if self.basis == "volume" else ""
        return f"drawn from the {rows} of {self.file}{alike}"

    def build(self) -> SizeLaw:
        """Return the distribution of radii over their mean."""
        return ListedDistribution(np.array(self.diameters) / self.own_mean, self.basis == "volume")

    def entries(self) -> dict[str, Any]:
        """Return the diameters as one text, without the name of the file."""
        unit = "m" if self.absolute else "1"
        entries = {"law": self.law, "unit": unit, "diameters": " ".join(map(repr, self.diameters))}
        return entries if self.basis == "number" else {**entries, "basis": self.basis}


def _read_error(value: Any) -> float:
    """Return the standard error of a share, above 0 and below 1."""
    number = to_si(value, "1")
    if not 0.0 < number < 1.0:
        raise ValueError(f"is {quoted(value)}; must be above 0 and below 100 %")
    return number


class CurveSizes(FileSizes):
    """Diameters by a cumulative curve or a histogram in a file, as `data` reads it.

    Grains of the same amount each stand for it; the logarithm of the diameter is uniform within a
    class. It must have a size with nothing below it, and one with nothing above it: most grains by
    number are the finest. The error does not change samples: `agglom check` says what it means for
    the mean diameters.

    Attributes
    ----------
    error
        Standard error of each share, or of each value of a cumulative curve, if the file has no
        column of errors.
    column
        Heading of the column to read, where a file has several amounts or sizes.
    unit
        Unit of the sizes, where their heading has none.
    headings
        Known headings in place of those of the file: `{finer wt: passing (%)}`.
    counted
        Number of grains that were counted for the shares, in place of `error`.
    """

    not_in_files = (*FileSizes.not_in_files, "basis", "mean_errors")
    law: Literal["curve"] = "curve"  # type: ignore[assignment]
    example: ClassVar[str] = "{law: curve, file: sieve.csv, error: 2 percent}"
    error: Annotated[float | None, Reads(_read_error)] = None
    column: Line = ""
    unit: Line = ""
    headings: dict[Line, Line] | None = None
    counted: Annotated[int, Whole(at_least=10)] | None = None
    mean_errors: tuple[float, ...] = ()

    def errors_of_means(self) -> tuple[float, ...]:
        """Return the errors of the means that follow from the errors of the curve."""
        return self.mean_errors

    @property
    def summary(self) -> str:
        """One line on the law."""
        amount = "mass" if self.basis == "volume" else "number"
        rows = pluralise(len(self.diameters), "diameter")
        return f"the curve by {amount} of {self.file}, as {rows} of the same {amount}"


def are_lengths(data: Any, reading: Reading = PLAIN) -> bool:
    """Return whether an entry `sizes`, not validated yet, says how large grains are.

    A law of one's own does by any number that is a length.
    """
    if not isinstance(data, dict):
        return False
    name = data.get("law")
    if names_own(name):
        with suppress(UnknownComponentError):  # its own field says so
            fields = class_named(Sizes, name, reading).model_fields
            return any(unit_of(field) == "m" and key in data for key, field in fields.items())
    return any(key in data for key in LENGTH_KEYS) or data.get("absolute") is True


def law_of_file(data: Any, reading: Reading = PLAIN) -> type[Sizes] | None:
    """Return the law of an entry `sizes`, not validated yet, if it reads a file with diameters."""
    if not isinstance(data, dict) or not isinstance(data.get("file"), str):
        return None
    name = Sizes.as_mapping(data)["law"]
    with suppress(UnknownComponentError):  # its own field says so
        law = class_named(Sizes, name, reading)
        return law if law.reads_file else None
    return None
