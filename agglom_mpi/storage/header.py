"""The attributes of a campaign file: what it says of the campaign as a whole."""

import json
from pathlib import Path
from typing import Any

from agglom_mpi.storage.schema import fresh_from


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
        return f"<{type(self).__name__} {str(self.path)!r}: {self.attributes['title']}>"

    @property
    def campaign_text(self) -> str:
        """The campaign, as YAML."""
        return str(self.attributes["campaign"])

    @property
    def identity(self) -> dict[str, Any]:
        """What makes the campaign what it is; raises ValueError if it cannot be read."""
        return dict(json.loads(self.attributes["identity"]))

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
    def format_version(self) -> int:
        """Format version of the file."""
        return int(self.attributes["format_version"])

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
