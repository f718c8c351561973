"""Files of sizes and impacts that a campaign names: read beside it, or taken from its identity."""

import math
from collections.abc import Mapping
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from agglom_mpi.declaration.reading import NamedFiles
from agglom_mpi.declaration.spelling import MAX_MAGNITUDE
from agglom_mpi.declaration.units import quoted
from agglom_mpi.measurements.files.curve_file import read_curve_grains, read_size_curve
from agglom_mpi.measurements.files.impact_file import MeasuredImpacts, read_impacts
from agglom_mpi.measurements.files.size_columns import CurveKeys
from agglom_mpi.measurements.files.size_curve import POWER, SizeCurve
from agglom_mpi.measurements.files.size_table import read_diameters

CURVE_NUMBERS: Final = ("edges", "shares", "errors")
"""Entries of an identity with the numbers of a file of sizes; of impacts: their fields."""


class FilesBeside(NamedFiles):
    """Reads files in the folder of the campaign file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def diameters(self, name: str, keys: CurveKeys | None) -> dict[str, Any]:
        """Return what is read of a file of grains or, with keys, of a curve."""
        if keys is not None:
            return read_curve_grains(self.folder, name, keys)
        values, absolute = read_diameters(self.folder, name)
        return {"diameters": values, "absolute": absolute}

    def curve(self, place: int, name: str, keys: CurveKeys) -> SizeCurve:
        """Return the curve of a file."""
        return read_size_curve(self.folder, name, keys)

    def impacts(self, place: int, name: str, keys: CurveKeys) -> MeasuredImpacts:
        """Return the impacts of a file."""
        return read_impacts(self.folder, name, keys)


class RecordedFiles(NamedFiles):
    """Gives the numbers that the identity of a stored campaign has, whatever the files.

    All methods raise a ValueError if these are damaged.
    """

    def __init__(self, identity: Mapping[str, Any]) -> None:
        self.identity = identity

    def diameters(self, name: str, keys: CurveKeys | None) -> dict[str, Any]:
        """Return what was read of the file of the law of sizes."""
        values = self._numbers("scene.sizes.diameters")
        _require(bool(values) and all(0.0 < each < MAX_MAGNITUDE for each in values), name)
        found = {"diameters": values, "absolute": self.identity.get("scene.sizes.unit") == "m"}
        basis = self.identity.get("scene.sizes.basis")
        return found if basis is None else {**found, "basis": basis}

    def curve(self, place: int, name: str, keys: CurveKeys) -> SizeCurve:
        """Return the curve of an entry of `data`."""
        of, weight = (self.identity.get(f"data.{place}.{k}") for k in ("errors_of", "weight"))
        edges, shares, errors = (self._numbers(f"data.{place}.{key}") for key in CURVE_NUMBERS)
        lengths = {"shares": len(shares), "passing": len(shares) - 1}
        is_whole = (
            len(edges) == len(shares) + 1 > 2
            and weight in POWER
            and lengths.get(str(of)) == len(errors)
            and all(low < high for low, high in pairwise(edges))
            and all(math.isfinite(each) for each in (*shares, *errors))
            and math.isclose(math.fsum(shares), 1.0, abs_tol=1e-6)
        )
        _require(is_whole, name)
        return SizeCurve(edges, shares, errors, of, weight)  # type: ignore[arg-type]

    def impacts(self, place: int, name: str, keys: CurveKeys) -> MeasuredImpacts:
        """Return the impacts of an entry of `data`."""
        numbers = [self._numbers(f"data.{place}.{key}") for key in MeasuredImpacts._fields]
        found = MeasuredImpacts(*numbers)
        _require(len({*map(len, numbers)}) == 1 and found.is_possible, name)
        return found

    def of_experiment(self, name: str) -> "RecordedFiles":
        """Return what gives the numbers of an experiment."""
        start = f"experiments.{name}."
        own = {k.removeprefix(start): v for k, v in self.identity.items() if k.startswith(start)}
        return RecordedFiles(own)

    def _numbers(self, entry: str) -> tuple[float, ...]:
        """Return the numbers of a recorded text; none if it is damaged."""
        with suppress(ValueError):
            return tuple(float(word) for word in str(self.identity.get(entry)).split())
        return ()


def _require(is_whole: bool, name: str) -> None:
    if not is_whole:
        raise ValueError(f"is {quoted(name)}, whose recorded numbers are damaged")
