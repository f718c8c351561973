"""The attributes of a campaign file, which describe the campaign as a whole."""

import json
import logging
import zlib
from collections.abc import Collection, Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.config.identity import SEPARATORS, STUDY_SEPARATORS, digest
from agglom_mpi.declaration.reading import (
    OWN_COMPONENTS,
    OWN_MODULES,
    OWN_SHA256,
    SOURCE_SHA256,
    Reading,
    own_names,
)
from agglom_mpi.errors import CodeNotAllowedError
from agglom_mpi.formatting import shortened
from agglom_mpi.measurements.layout import CensusLayout
from agglom_mpi.storage.columns import CENSUS, census_of
from agglom_mpi.storage.schema import (
    CHECKED_SINCE,
    VARIABLE_TABLE,
    fresh_from,
    quantities_of,
    volumes_of_file,
)
from agglom_mpi.storage.stored_variables import variables_of
from agglom_mpi.variables import VariableTable

if TYPE_CHECKING:
    import h5py

    from agglom_mpi.config.user_function import UserFunction

Allowed = bool | Collection[tuple[str, str]]
"""Whether code of one's own in a file may be executed: all, none, or modules by name and digest."""

LOG: Final = logging.getLogger(__name__)

_TEXTS: Final = (
    *("campaign", "campaign_sha256", "code_version", "created"),
    *("identity", "sources_sha256", "title"),
)
_LEAST: Final = {"seed": 0, "strings": 1, "max_samples": 1, "population": 1}
"""Least values of numbers that every file has."""
_LEAST_OPTIONAL: Final = {"fresh_from": 0, "grains": 0, "final_particles": 0, "frames": 0}
"""Least values of numbers that older files lack."""
_TEXTS_OPTIONAL: Final = ("purpose", "quantities", CENSUS, OWN_MODULES, OWN_COMPONENTS, OWN_SHA256)
"""Texts that older files lack, and those of campaigns without code of one's own."""

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
    volumes_of_file(attributes)
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
    allow_code
        Whether code of one's own that the file has may be executed.

    Attributes
    ----------
    altered
        Attributes and tables that are not as they were written.
    """

    def __init__(self, path: Path, attributes: dict[str, Any], allow_code: Allowed = False) -> None:
        self.path = path
        self.attributes = attributes
        self.allow_code = allow_code
        self.altered: list[str] = []

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {str(self.path)!r}: {self.title}>"

    @property
    def campaign_text(self) -> str:
        """The campaign, as YAML."""
        return str(self.attributes["campaign"])

    @property
    def title(self) -> str:
        """The title of the campaign, printable and of a bounded length."""
        return shortened(self.attributes["title"])

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

    @cached_property
    def reading(self) -> Reading:
        """How the campaign is read: as it was recorded, and with its own components.

        Raises
        ------
        CodeNotAllowedError
            If these may not be executed.
        """
        self.require_code()
        if OWN_MODULES not in self.attributes:
            return Reading(recorded=True)
        # Imported here: the others are read without what reads modules.
        from agglom_mpi.config.own_components import RecordedModules

        own = RecordedModules(self.attributes, self.identity, self.path.parent)
        return Reading(recorded=True, own=own)

    def _may_run(self, file: str, sha256: str) -> bool:
        """Return whether a module may be executed."""
        if isinstance(self.allow_code, bool):
            return self.allow_code
        return (file, sha256) in self.allow_code

    @cached_property
    def allowed(self) -> "UserFunction | None":
        """The user's function of the campaign, where the file has its source and it may run."""
        if not self.allow_code or OWN_MODULES not in self.attributes:
            return None
        from agglom_mpi.config.own_components import recorded_source
        from agglom_mpi.config.user_function import recorded_function
        from agglom_mpi.declaration.own_modules import OwnModule

        function = recorded_function(self.identity)
        if function is None or not self._may_run(function.file, function.sha256):
            return None
        source = recorded_source(self.attributes, function.file, function.sha256)
        if source is None:
            return None
        folder = OwnModule.of(function.file, source, self.path.parent).folder
        return function._replace(source=source, folder=folder)

    @cached_property
    def code_note(self) -> str:
        """A line on the campaign's own code that may not run; then a file is its tables alone.

        It is empty of a campaign without such code, and where that may run.
        """
        digests = {
            name: str(self.identity[f"{section}.{SOURCE_SHA256}"])
            for section, name in own_names(self.identity).items()
        }
        refused = [
            name
            for name, digest in digests.items()
            if not self._may_run(name.partition(":")[0], digest)
        ]
        of_means = self.identity.get("objective.of_means")
        if of_means is not None and self.allowed is None:
            refused.append(of_means)
        names = ", ".join(refused)
        return f"{self.path} has code of its own ({names}); --allow-code runs it" if names else ""

    def require_code(self) -> None:
        """Raise a CodeNotAllowedError if the campaign has code of its own that may not run."""
        if self.code_note:
            raise CodeNotAllowedError(self.code_note)

    def note_altered(self, names: Iterable[str]) -> None:
        """Record, and log as a warning, attributes and tables that are altered."""
        if new := [name for name in names if name not in self.altered]:
            self.altered += new
            LOG.warning("%s: a damaged campaign file (%s altered)", self.path, ", ".join(new))

    @property
    def quantities(self) -> dict[str, str]:
        """SI units of the quantities of a sample by name, in the order of their columns."""
        return quantities_of(self.attributes)

    @property
    def census(self) -> CensusLayout | None:
        """When censuses of a sample were taken, and in which classes; None: none were."""
        return census_of(self.attributes)

    @property
    def format_version(self) -> int:
        """Format version of the file."""
        return int(self.attributes["format_version"])

    @cached_property
    def variables(self) -> VariableTable:
        """The variables of its strings."""
        return variables_of(self.attributes)

    @property
    def volumes(self) -> tuple[int, ...]:
        """Larger control volumes that the file has tables of samples for, ascending."""
        return volumes_of_file(self.attributes)

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
