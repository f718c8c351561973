"""Text where not every character can be written: nothing that is printed may end a run."""

import codecs
import sys
from typing import Final

SPELLED: Final = {
    "±": "+-",
    "µ": "u",
    "×": "x",
    "·": "*",
    "−": "-",
    "–": "-",
    "—": "-",
    "…": "...",
    "≤": "<=",
    "≥": ">=",
    "°": "deg",
    "²": "^2",
    "³": "^3",
    "━": "#",
    "─": "-",
}
"""How the program's own characters are written where there is nothing but ASCII."""


def _spell(error: UnicodeError) -> tuple[str, int]:
    """Spell out what cannot be encoded; what is not ours is escaped as Python does."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    characters = error.object[error.start : error.end]
    escaped = (
        SPELLED.get(c) or c.encode("ascii", "backslashreplace").decode("ascii") for c in characters
    )
    return "".join(escaped), error.end


codecs.register_error("spelled", _spell)


def spelled(text: str, encoding: str) -> str:
    """Return the text as it can be written in an encoding."""
    return text.encode(encoding, "spelled").decode(encoding)


def write_anything() -> None:
    """Let standard output and standard error take any text, whatever their encoding is."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # else somebody has put something of his own there
            stream.reconfigure(errors="spelled")
