"""The file of sizes that a scene may name: read beside the campaign, or from its identity."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from agglom_mpi.config.bounded_reading import read_bounded
from agglom_mpi.config.units import quoted, to_si
from agglom_mpi.file_kinds import begins_as_hdf5

MAX_BYTES: Final = 1 << 20
"""Largest size of a file of sizes."""
MAX_ROWS: Final = 10_000
MAX_RATIO: Final = 100.0
"""Largest over smallest diameter, at most."""


class Diameters(NamedTuple):
    """Diameters of grains: in m if they are `absolute`, else relative to each other."""

    values: tuple[float, ...]
    absolute: bool


SizeReader = Callable[[str], Diameters]
"""Returns the diameters of a file by its name; raises a ValueError that says what is wrong."""


def unread(name: str) -> Diameters:
    """Refuse a file of sizes: a campaign's text alone does not say where it is."""
    raise ValueError(f"is {quoted(name)}, which is read beside a campaign file; this text has none")


def read_beside(folder: Path) -> SizeReader:
    """Return a reader of files in a folder."""
    return lambda name: read_diameters(folder, name)


def recorded_sizes(identity: Mapping[str, Any]) -> SizeReader:
    """Return a reader that gives the diameters of a stored campaign's identity, whatever the file.

    Raises
    ------
    ValueError
        By the reader, if they are damaged.
    """

    def read(name: str) -> Diameters:
        text, unit = (identity.get(f"scene.sizes.{key}") for key in ("diameters", "unit"))
        return _checked(str(text).split(), unit == "m", name)

    return read


def read_diameters(folder: Path, name: str) -> Diameters:
    """Read a text of one diameter a line, after a heading like `diameter (um)`.

    Without a heading, or a unit in it, they are relative to each other.

    Raises
    ------
    ValueError
        If it cannot be read, or holds something else.
    """
    if not name.isprintable():
        raise ValueError(f"is {quoted(name)}, which holds a character that cannot be printed")
    path = folder / name
    if begins_as_hdf5(path):
        raise ValueError(f"is {quoted(name)}, an HDF5 file; must be a text of one diameter a line")
    try:
        text = read_bounded(path, MAX_BYTES).decode("utf-8-sig")
    except OSError as error:
        raise ValueError(
            f"is {quoted(name)}, but {path} cannot be read: {error.strerror}"
        ) from None
    except UnicodeDecodeError:
        raise ValueError(f"is {quoted(name)}, which is no text in UTF-8") from None
    rows = [row.strip().rstrip(",;").strip() for row in text.splitlines()]
    rows = [row for row in rows if row and not row.startswith("#")]
    unit = "" if not rows or _is_number(rows[0]) else _unit(rows.pop(0), name)
    return _checked(rows, bool(unit), name, to_si(f"1 {unit}", "m") if unit else 1.0)


def _unit(heading: str, name: str) -> str:
    """Return the unit in parentheses of a heading, empty if there is none."""
    word, _, rest = heading.strip('"').partition("(")
    unit = rest.partition(")")[0].strip()
    if word.strip().lower() not in ("diameter", "diameters"):
        raise ValueError(
            f"is {quoted(name)}, whose first line is {quoted(heading)}; must be a heading like "
            "'diameter (um)', or a number"
        )
    if unit:
        try:
            to_si(f"1 {unit}", "m")
        except ValueError as error:
            raise ValueError(
                f"is {quoted(name)}, whose heading is {quoted(heading)}: {error}"
            ) from None
    return "" if unit == "1" else unit


def _checked(rows: list[str], absolute: bool, name: str, factor: float = 1.0) -> Diameters:
    """Return the numbers of rows, times a factor, if they can be diameters."""
    if not 1 <= len(rows) <= MAX_ROWS:
        raise ValueError(
            f"is {quoted(name)}, which has {len(rows):,} diameters; allowed: 1 to {MAX_ROWS:,}"
        )
    for number, row in enumerate(rows, 1):
        if not _is_number(row) or not 0.0 < float(row) < 1e100:
            raise ValueError(
                f"is {quoted(name)}, whose diameter {number} is {quoted(row)}; must be one number "
                "greater than 0 a line"
            )
    # 40 um are 40/1e6 m to the bit, as in a campaign file; 40 * 1e-6 are not.
    whole = round(1.0 / factor)
    divides = whole > 0 and 1.0 / whole == factor
    values = tuple(float(row) / whole if divides else float(row) * factor for row in rows)
    if max(values) > MAX_RATIO * min(values):
        raise ValueError(
            f"is {quoted(name)}, with diameters from {min(values):g} to {max(values):g}; the "
            f"largest must be at most {MAX_RATIO:g} times the smallest"
        )
    return Diameters(values, absolute)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
