"""Files that the section `data` names: read beside the campaign, or from its identity."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

from agglom_mpi.config.data_section import CURVE_NUMBERS, DatumEntry
from agglom_mpi.config.size_choice import CurveKeys
from agglom_mpi.config.size_curve import POWER, SizeCurve
from agglom_mpi.config.size_curve_file import read_size_curve
from agglom_mpi.declaration.declared import FieldError, FieldPath
from agglom_mpi.declaration.reading import DataFiles
from agglom_mpi.declaration.units import quoted


class DataBesideCampaign(DataFiles):
    """Reads files in the folder of the campaign file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def curve(self, place: int, name: str, keys: CurveKeys) -> SizeCurve:
        """Return the curve of a file."""
        return read_size_curve(self.folder, name, keys)


class RecordedData(DataFiles):
    """Gives the curves that the identity of a stored campaign has, whatever the files."""

    def __init__(self, identity: Mapping[str, Any]) -> None:
        self.identity = identity

    def curve(self, place: int, name: str, keys: CurveKeys) -> SizeCurve:
        """Return the curve of an entry by its place in the section."""
        entries = {key: self.identity.get(f"data.{place}.{key}") for key in _RECORDED}
        edges, shares, errors = (_numbers(entries[key]) for key in CURVE_NUMBERS)
        of, weight = entries["errors_of"], entries["weight"]
        count = len(shares)
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


_RECORDED = (*CURVE_NUMBERS, "errors_of", "weight")


def _numbers(text: object) -> tuple[float, ...]:
    """Return the numbers of a recorded text; none if it is damaged."""
    with suppress(ValueError):
        return tuple(float(word) for word in str(text).split())
    return ()


def with_curves(
    data: Sequence[DatumEntry], files: DataFiles
) -> tuple[tuple[DatumEntry, ...], list[tuple[FieldPath, str]]]:
    """Return the entries with what their files hold, and what is wrong with these."""
    found, problems = [], []
    for place, entry in enumerate(data):
        if entry.file is None:
            found.append(entry)
            continue
        try:
            found.append(entry.with_curve(files.curve(place, entry.file, entry.curve_keys)))
        except FieldError as error:
            problems += [((place, *path), message) for path, message in error.problems]
        except ValueError as error:
            problems.append(((place, "file"), str(error)))
    return tuple(found), problems
