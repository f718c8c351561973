"""How the text of a campaign is read: as it is today or was recorded, and with which own classes.

A `Reading` is the context of pydantic's validation. Whoever maps the name of a component to its
class, such as `components.class_named`, asks it for the classes of one's own.
"""

import re
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeGuard

from agglom_mpi.declaration.units import quoted

if TYPE_CHECKING:
    from pydantic import ValidationInfo

OWN_NAME: Final = re.compile(r"([^\W\d]\w*)\.py:([^\W\d]\w*)")
"""Regular expression of the name of a component of one's own, `FILE.py:Class`."""


def names_own(name: object) -> TypeGuard[str]:
    """Return whether a name is meant for a component of one's own: it holds the end of a file."""
    return isinstance(name, str) and ".py" in name


class OwnComponents:
    """Finds the classes of a campaign's own components; this one finds none."""

    def find(self, name: str) -> type[Any]:
        """Return the class `FILE.py:Class`.

        Raises
        ------
        ValueError
            If there is none, or its code may not run; with the reason.
        """
        raise ValueError(
            f"is {quoted(name)}, which is read beside a campaign file; this text has none"
        )


class Reading(NamedTuple):
    """How the text of a campaign is read.

    Attributes
    ----------
    recorded
        Whether a run has recorded the text, which is then read as it was, also where it is refused
        today.
    own
        Finds the components of one's own that it names.
    """

    recorded: bool = False
    own: OwnComponents = OwnComponents()


PLAIN: Final = Reading()
"""Reading of a text alone."""


def reading_of(info: "ValidationInfo") -> Reading:
    """Return how the text that is validated is read."""
    return info.context if isinstance(info.context, Reading) else PLAIN
