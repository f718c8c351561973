"""The attributes of a campaign file: what they must be, and their checksums; the identity."""

import json
import zlib
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.config.identity import SEPARATORS, STUDY_SEPARATORS, digest
from agglom_mpi.declaration.reading import OWN_COMPONENTS, OWN_MODULES, OWN_SHA256
from agglom_mpi.storage.room import CENSUS, QUANTITIES, TableSizes
from agglom_mpi.storage.schema import CHECKED_SINCE, VARIABLE_TABLE

if TYPE_CHECKING:
    import h5py

_TEXTS: Final = (
    *("campaign", "campaign_sha256", "code_version", "created"),
    *("identity", "sources_sha256", "title"),
)
_LEAST: Final = {"seed": 0, "strings": 1, "max_samples": 1, "population": 1}
"""Least values of numbers that every file has."""
_LEAST_OPTIONAL: Final = {"fresh_from": 0, "grains": 0, "final_particles": 0, "frames": 0}
"""Least values of numbers that older files lack."""
EARLIER_DATA: Final = "earlier_data"
"""Attribute with what was measured before, and until when it decided, as JSON."""
_TEXTS_OPTIONAL: Final = (
    *("purpose", QUANTITIES, CENSUS, OWN_MODULES, OWN_COMPONENTS, OWN_SHA256, EARLIER_DATA),
)
"""Texts that older files lack, and those of campaigns without code of one's own."""


def check_attributes(attributes: Mapping[str, Any]) -> TableSizes:
    """Return the sizes of a file; raise a ValueError if its attributes are of no campaign file.

    The identity must have the digest that is stored with it, so that its entries are those that
    were written.
    """
    for name in _TEXTS + _TEXTS_OPTIONAL:
        if not _is_text(attributes.get(name, None if name in _TEXTS else "")):
            raise ValueError(f"attribute {name} is no text")
    for name, least in (_LEAST | _LEAST_OPTIONAL).items():
        value = attributes.get(name, None if name in _LEAST else least)
        if not isinstance(value, int) or value < least:
            raise ValueError(f"attribute {name} is no whole number of at least {least}")
    if attributes.get("fresh_from", 0) > attributes["max_samples"]:
        raise ValueError("attribute fresh_from is above max_samples")
    identity_of(attributes)
    earlier_data(attributes)
    return TableSizes.of(attributes)


def earlier_data(attributes: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return what a file has of earlier data, in order: `legs`, `strings` and `data`.

    Each has the number of legs and strings that there were when the next data came, and its entries
    of the identity. Raises a ValueError if the attribute is none that a run writes.
    """
    try:
        found = json.loads(attributes.get(EARLIER_DATA, "[]"))
        kinds = {(*(type(each[key]) for key in ("legs", "strings", "data")),) for each in found}
    except (KeyError, RecursionError, TypeError, ValueError):
        kinds = {()}
    if kinds - {(int, int, dict)}:
        raise ValueError(f"attribute {EARLIER_DATA} is no JSON list of what was measured before")
    return list(found)


def _is_text(value: Any) -> bool:
    """Return whether a value is a text that can be written as UTF-8, as all of the file's are."""
    if not isinstance(value, str):
        return False
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


def identity_of(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the identity; raises ValueError if it is not what its digest was taken of."""
    try:
        found = json.loads(attributes["identity"])
    except (RecursionError, ValueError):
        found = None
    if not isinstance(found, dict):
        raise ValueError("attribute identity is no JSON object")
    digests = {digest(found, separators) for separators in (SEPARATORS, STUDY_SEPARATORS)}
    if attributes["campaign_sha256"] not in digests:
        raise ValueError("attribute identity has another digest than campaign_sha256")
    return found


CHECKSUMS: Final = "checksums"
"""Attribute with the checksums of the others, and of `/variables`, by name."""
_BOX: Final = f"/{VARIABLE_TABLE.name}"
"""Name of the checksum of the rows of `/variables`."""


def write_checksums(file: "h5py.File", changed: Iterable[str] | None = None) -> None:
    """Write the attribute `checksums` of a file: those that have `changed`, by default all.

    So the checksum of an altered attribute that is copied still does not fit.
    """
    known = {} if changed is None else json.loads(file.attrs[CHECKSUMS])
    every = [_BOX, *(f"{name}/{key}" for name, part in file.items() for key in part.attrs)]
    names = [*every, *(file.attrs.keys() - {CHECKSUMS})] if changed is None else changed
    file.attrs[CHECKSUMS] = json.dumps(known | {name: _checksum(file, name) for name in names})


def altered_parts(file: "h5py.File") -> list[str]:
    """Return the names of attributes and tables that differ from their checksums, or are absent.

    Files of versions before `CHECKED_SINCE` have none. Attributes that others have added do not
    count.
    """
    if CHECKSUMS not in file.attrs:
        return [CHECKSUMS] if file.attrs["format_version"] >= CHECKED_SINCE else []
    try:
        known = dict(json.loads(file.attrs[CHECKSUMS]))
    except (RecursionError, TypeError, ValueError):
        return [CHECKSUMS]
    return [name for name, checksum in known.items() if _checksum(file, name) != checksum]


def _checksum(file: "h5py.File", name: str) -> int | None:
    """Return the CRC-32 of an attribute, as JSON, or of the rows of `/variables`; None: absent."""
    if name == _BOX:
        return zlib.crc32(file[name][...].tobytes())
    table, _, key = name.rpartition("/")
    if (table and table not in file) or key not in file[table or "/"].attrs:
        return None
    value = np.asarray(file[table or "/"].attrs[key], object).tolist()
    return zlib.crc32(json.dumps(value, default=repr).encode())
