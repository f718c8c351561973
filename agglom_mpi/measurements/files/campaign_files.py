"""Files of sizes that a campaign names: read beside it, or taken from its identity."""

import math
from collections.abc import Mapping
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from agglom_mpi.declaration.bounded_reading import quoted_start
from agglom_mpi.declaration.reading import NamedFiles
from agglom_mpi.declaration.units import quoted
from agglom_mpi.measurements.files.curve_file import read_size_curve
from agglom_mpi.measurements.files.grain_file import Diameters, check_diameters, read_diameters
from agglom_mpi.measurements.files.size_curve import POWER, SizeCurve
from agglom_mpi.measurements.files.size_table import CurveKeys
from agglom_mpi.measurements.files.text_table import is_number

CURVE_NUMBERS: Final = ("edges", "shares", "errors")
"""Entries of an identity with the numbers of a file."""


class FilesBeside(NamedFiles):
    """Reads files in the folder of the campaign file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def diameters(self, name: str) -> Diameters:
        """Return the diameters of a file of grains."""
        return read_diameters(self.folder, name)

    def curve(self, place: int, name: str, keys: CurveKeys) -> SizeCurve:
        """Return the curve of a file."""
        return read_size_curve(self.folder, name, keys)


class RecordedFiles(NamedFiles):
    """Gives the numbers that the identity of a stored campaign has, whatever the files."""

    def __init__(self, identity: Mapping[str, Any]) -> None:
        self.identity = identity

    def diameters(self, name: str) -> Diameters:
        """Return the diameters of the law of sizes; raise a ValueError if they are damaged."""
        text, unit = (self.identity.get(f"scene.sizes.{key}") for key in ("diameters", "unit"))
        words = str(text).split()
        values = tuple(float(word) if is_number(word) else 0.0 for word in words)
        try:
            check_diameters(values, lambda row: f"diameter {row + 1}: {quoted_start(words[row])}")
        except ValueError as error:
            raise ValueError(f"is {quoted(name)}: {error}") from None
        return values, unit == "m"

    def curve(self, place: int, name: str, keys: CurveKeys) -> SizeCurve:
        """Return the curve of an entry of `data`; raise a ValueError if it is damaged."""
        entries = {
            key: self.identity.get(f"data.{place}.{key}")
            for key in (*CURVE_NUMBERS, "errors_of", "weight")
        }
        edges, shares, errors = (_numbers(entries[key]) for key in CURVE_NUMBERS)
        of, weight, count = entries["errors_of"], entries["weight"], len(shares)
        lengths = {"shares": count, "passing": count - 1}
        is_whole = (
            count > 1
            and len(edges) == count + 1
            and weight in POWER
            and lengths.get(str(of)) == len(errors)
            and all(low < high for low, high in pairwise(edges))
            and all(math.isfinite(each) for each in (*shares, *errors))
            and math.isclose(math.fsum(shares), 1.0, abs_tol=1e-6)
        )
        if not is_whole:
            raise ValueError(f"is {quoted(name)}, whose recorded numbers are damaged")
        return SizeCurve(edges, shares, errors, of, weight)  # type: ignore[arg-type]


def _numbers(text: object) -> tuple[float, ...]:
    """Return the numbers of a recorded text; none if it is damaged."""
    with suppress(ValueError):
        return tuple(float(word) for word in str(text).split())
    return ()
