"""The attributes of a campaign file, which describe the campaign as a whole."""

import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from agglom_mpi.config.identity import SEPARATORS, STUDY_SEPARATORS, digest
from agglom_mpi.formatting import printable
from agglom_mpi.storage.schema import fresh_from, quantities_of, variables_of
from agglom_mpi.variables import VariableTable

_TEXTS: Final = (
    *("campaign", "campaign_sha256", "code_version", "created"),
    *("identity", "sources_sha256", "title"),
)
_LEAST: Final = {"seed": 0, "strings": 1, "max_samples": 1, "population": 1}
"""Least values of numbers that every file has."""
_LEAST_OPTIONAL: Final = {"fresh_from": 0, "grains": 0, "final_particles": 0, "frames": 0}
"""Least values of numbers that older files lack."""
_TEXTS_OPTIONAL: Final = ("purpose", "quantities")
"""Texts that some files lack."""


def check_attributes(attributes: Mapping[str, Any]) -> None:
    """Raise a ValueError if the attributes of a file are not what a campaign file has.

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
    variables_of(attributes)
    _entries(attributes)


def _is_text(value: Any) -> bool:
    """Return whether a value is a text that can be written as UTF-8, as all of the file's are."""
    if not isinstance(value, str):
        return False
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


def _entries(attributes: Mapping[str, Any]) -> dict[str, Any]:
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


class CampaignHeader:
    """The attributes of a campaign file, which do not change while it grows.

    Parameters
    ----------
    path
        The file.
    attributes
        As h5py reads them, numbers as those of Python.
    """

    def __init__(self, path: Path, attributes: dict[str, Any]) -> None:
        self.path = path
        self.attributes = attributes

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {str(self.path)!r}: {self.title}>"

    @property
    def campaign_text(self) -> str:
        """The campaign, as YAML."""
        return str(self.attributes["campaign"])

    @property
    def title(self) -> str:
        """The title of the campaign, printable."""
        return printable(self.attributes["title"])

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Identity of the campaign, flat: `scene.particles` -> 100, in SI units."""
        return _entries(self.attributes)

    def section(self, name: str) -> dict[str, Any]:
        """Return the entries of a section of the identity, nested as in the campaign's text."""
        nested: dict[str, Any] = {}
        for path, value in self.identity.items():
            first, *keys = path.split(".")
            if first == name and keys:
                inner = nested
                for key in keys[:-1]:
                    inner = inner.setdefault(key, {})
                inner[keys[-1]] = value
        return nested

    @property
    def quantities(self) -> dict[str, str]:
        """SI units of the quantities of a sample by name, in the order of their columns."""
        return quantities_of(self.attributes)

    @property
    def format_version(self) -> int:
        """Format version of the file."""
        return int(self.attributes["format_version"])

    @cached_property
    def variables(self) -> VariableTable:
        """The variables of its strings."""
        return variables_of(self.attributes)

    @property
    def seed(self) -> int:
        """The seed of all random streams."""
        return int(self.attributes["seed"])

    @property
    def max_samples(self) -> int:
        """Samples that there is room for of each string, fresh ones included."""
        return int(self.attributes["max_samples"])

    @property
    def fresh_from(self) -> int:
        """Number of the first fresh sample of each string: decisions see only those before it."""
        return fresh_from(self.attributes)
