"""The entry `sizes` of a scene: laws of the grains' sizes at the start."""

import math
from functools import cached_property, partial
from typing import Annotated, Any, ClassVar, Final, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from agglom_mpi.declaration.sections import LATER, NAMED, FieldError, Line, Section
from agglom_mpi.declaration.units import Number, to_si
from agglom_mpi.formatting import pluralise, value_with_prefix
from agglom_mpi.physics.sizes import (
    ListedSizes,
    LognormalSizes,
    SizeLaw,
    UniformSizes,
    VolumeUniformSizes,
)

LENGTHS = ("median", "smallest", "largest")
"""Keys of which one in a law says that it is of lengths, and so fixes the size of the grains."""

READ_KEYS = ("diameters", "absolute")
"""Fields of a law of a file that are read from it."""

_Length = Annotated[Annotated[float, Field(gt=0)] | None, BeforeValidator(partial(to_si, unit="m"))]
_Beyond = Annotated[Number, Field(gt=1, le=10)]

Basis = Annotated[Literal["number", "volume"], LATER]
"""Whether a distribution counts grains or their volume, as sieves and laser diffraction do."""

_BY: Final[dict[str, str]] = {"number": "", "volume": " by volume"}
"""Words for each basis in the summary of a law."""


class _SizeSection(Section):
    """Base of the laws; `mean_diameter` is in m, None where another key of the scene says it.

    The mean is by number on either basis, as everywhere else in a scene.
    """

    requires: ClassVar[tuple[str, ...]] = ()

    @property
    def mean_diameter(self) -> float | None:
        """Mean diameter in m; None where the law is of sizes relative to the mean."""
        raise NotImplementedError

    @cached_property
    def size_law(self) -> SizeLaw:
        """The law of radii over their mean; one object, which calculates its moments once."""
        return self.build()

    def build(self) -> SizeLaw:
        """Return the law of radii over their mean."""
        raise NotImplementedError


class LognormalSection(_SizeSection):
    """Lognormal diameters; `spread` is the geometric standard deviation, the same on each basis.

    A `median` by volume is exp(3 ln² spread) times that by number (Hatch and Choate).
    """

    law: Literal["lognormal"]
    spread: Annotated[Number, Field(gt=1, le=3, description="like 1.3")]
    median: _Length = None
    basis: Basis = "number"

    @model_validator(mode="after")
    def _basis_is_of_a_median(self) -> Self:
        if self.basis == "volume" and self.median is None:
            message = (
                "is 'volume', which says what a median is of; give median, or leave it out, as the "
                "spread is the same by number and by volume"
            )
            raise FieldError((("basis",), message))
        return self

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
        """Return the law of radii over their mean."""
        return LognormalSizes(math.log(self.spread))


class UniformSection(_SizeSection):
    """Diameters uniform from `smallest` to `largest`, or with their `ratio` about the mean."""

    law: Literal["uniform"]
    smallest: _Length = None
    largest: _Length = None
    ratio: _Beyond | None = None
    basis: Basis = "number"

    @model_validator(mode="after")
    def _ends(self) -> Self:
        if self.smallest is None and self.largest is None and self.ratio is None:
            message = "is missing; give smallest and largest, or their ratio like 1.5"
            raise FieldError((("smallest",), message))
        if self.ratio is not None:
            if self.smallest is not None or self.largest is not None:
                message = "is given beside lengths; give smallest and largest, or their ratio"
                raise FieldError((("ratio",), message))
            return self
        for key in ("smallest", "largest"):
            if getattr(self, key) is None:
                raise FieldError(((key,), "is missing; a diameter like '50 um'"))
        if not self._smallest < self._largest:
            message = f"is {self._largest:g} m; must be greater than smallest, {self._smallest:g} m"
            raise FieldError((("largest",), message))
        if self._largest > 10.0 * self._smallest:
            message = f"is {self._largest:g} m; must be at most 10 times smallest"
            raise FieldError((("largest",), message))
        return self

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
        """Return the law of radii over their mean."""
        law = VolumeUniformSizes if self.basis == "volume" else UniformSizes
        return law(self._smallest / self._mean, self._largest / self._mean)


class FileSection(_SizeSection):
    """Diameters drawn from the rows of a file, which was read when the campaign was.

    `diameters` are in m, or relative to each other where the file gives no unit. All rows are as
    likely by number, or stand for the same volume of grains.
    """

    law: Literal["file"] = "file"
    file: Line
    diameters: tuple[float, ...] = ()
    absolute: bool = False
    basis: Basis = "number"

    @cached_property
    def _mean(self) -> float:
        """Mean diameter by number, in the unit of `diameters`."""
        if self.basis == "volume":  # a row has d⁻³ of the grains
            numbers = (np.array(self.diameters) / min(self.diameters)) ** -3
            return math.fsum(numbers * self.diameters) / math.fsum(numbers)
        return math.fsum(self.diameters) / len(self.diameters)

    @property
    def mean_diameter(self) -> float | None:
        """Mean diameter in m."""
        return self._mean if self.absolute else None

    @property
    def summary(self) -> str:
        """One line on the law."""
        rows = pluralise(len(self.diameters), "row")
        alike = ", each with the same volume of grains" if self.basis == "volume" else ""
        return f"drawn from the {rows} of {self.file}{alike}"

    def build(self) -> SizeLaw:
        """Return the law of radii over their mean."""
        return ListedSizes(np.array(self.diameters) / self._mean, self.basis == "volume")

    def entries(self) -> dict[str, Any]:
        """Return the diameters as one text, without the name of the file."""
        unit = "m" if self.absolute else "1"
        entries = {"law": self.law, "unit": unit, "diameters": " ".join(map(repr, self.diameters))}
        return entries if self.basis == "number" else {**entries, "basis": self.basis}


def _of_a_file(value: Any) -> Any:
    if isinstance(value, dict) and "file" in value and "law" not in value:
        return {"law": "file", **value}
    return value


Sizes = LognormalSection | UniformSection | FileSection
AnySizes = Annotated[
    Annotated[Sizes, Field(discriminator="law")] | None, NAMED, BeforeValidator(_of_a_file)
]


def are_lengths(data: Any) -> bool:
    """Return whether an entry `sizes`, not validated yet, says how large grains are."""
    if not isinstance(data, dict):
        return False
    return any(key in data for key in LENGTHS) or data.get("absolute") is True
