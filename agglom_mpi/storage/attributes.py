"""The attributes of a campaign file: what they must be, and the identity of the campaign."""

import json
from collections.abc import Mapping
from typing import Any, Final

from agglom_mpi.config.identity import SEPARATORS, STUDY_SEPARATORS, digest
from agglom_mpi.declaration.reading import OWN_COMPONENTS, OWN_MODULES, OWN_SHA256
from agglom_mpi.storage.room import CENSUS, QUANTITIES, TableSizes

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
