"""How the text of a campaign is read: as it is today or was recorded, and with which own classes.

Whoever maps the name of a component to its class, such as `components.class_named`, asks a
`Reading` for the classes of one's own.
"""

import re
from collections.abc import Mapping
from typing import Any, Final, NamedTuple, TypeGuard

from agglom_mpi.declaration.units import quoted
from agglom_mpi.variables import TEN, VariableTable

OWN_NAME: Final = re.compile(r"([^\W\d]\w*)\.py:([^\W\d]\w*)")
"""Regular expression of the name of a component of one's own, `FILE.py:Class`."""

SOURCE_SHA256: Final = "source_sha256"
"""Entry of an identity with the digest of code of one's own, beside those of its section."""

SOURCE_VALUES: Final = "source_values"
"""Entry of an identity with the values that this code has read, where there are some."""

OWN_MODULES: Final = "own_modules"
"""Name of the text, JSON, with the modules of one's own of a file."""
OWN_COMPONENTS: Final = "own_components"
"""Name of a text of files of earlier versions, which described the classes of these modules."""
OWN_SHA256: Final = "own_sha256"
"""Name of the SHA-256 of these two, one after the other, hexadecimal."""


ONLY_BESIDE: Final = "which is read beside a campaign file; this text has none"


def names_own(name: object) -> TypeGuard[str]:
    """Return whether a name is meant for a component of one's own: it holds the end of a file."""
    return isinstance(name, str) and ".py" in name


def own_names(identity: Mapping[str, Any]) -> dict[str, str]:
    """Return the components of one's own of an identity by section: `scene.friction`."""
    named = {entry.rpartition(".")[0]: name for entry, name in identity.items() if names_own(name)}
    return {
        section: name
        for section, name in named.items()
        if OWN_NAME.fullmatch(name) and f"{section}.{SOURCE_SHA256}" in identity
    }


def values_in(identity: Mapping[str, Any], section: str) -> tuple[tuple[str, str], ...]:
    """Return the values that the code of a section of an identity has read, by name."""
    start = f"{section}.{SOURCE_VALUES}."
    return tuple(
        sorted((k.removeprefix(start), str(v)) for k, v in identity.items() if k.startswith(start))
    )


class OwnComponents:
    """Finds the classes of a campaign's own components; this one finds none."""

    def find(self, name: str, kind: type[Any]) -> type[Any]:
        """Return the class `FILE.py:Class`, which should be one of a kind.

        Raises
        ------
        ValueError
            If there is none, or its code may not run; with the reason.
        """
        raise ValueError(f"is {quoted(name)}, {ONLY_BESIDE}")


NO_OWN: Final = OwnComponents()
"""Finds none."""


class NamedFiles:
    """Reads the files of sizes that a campaign names; this one reads none."""

    def diameters(self, name: str) -> Any:
        """Return the diameters of a file of grains, which `scene.sizes` names.

        Raises
        ------
        ValueError
            If it cannot be read, with the reason.
        """
        raise ValueError(f"is {quoted(name)}, {ONLY_BESIDE}")

    def curve(self, place: int, name: str, keys: Any) -> Any:
        """Return the size distribution of a file, which the section `data` names.

        Parameters
        ----------
        place
            Number of the entry, from 0.
        name
            Name of the file.
        keys
            What the entry states of it.

        Raises
        ------
        ValueError
            If it cannot be read, with the reason.
        """
        raise ValueError(f"is {quoted(name)}, {ONLY_BESIDE}")


NO_FILES: Final = NamedFiles()
"""Reads none."""


class Reading(NamedTuple):
    """How the text of a campaign is read.

    Attributes
    ----------
    recorded
        Whether a run has recorded the text, which is then read as it was, also where it is refused
        today.
    own
        Finds the components of one's own that it names.
    variables
        Variables of its strings.
    files
        Reads the files of sizes.
    earlier
        Fields of the mapping that is read which stand before the field, where they are right.
    """

    recorded: bool = False
    own: OwnComponents = NO_OWN
    variables: VariableTable = TEN
    files: NamedFiles = NO_FILES
    earlier: Mapping[str, Any] = {}


PLAIN: Final = Reading()
"""Reading of a text alone."""
