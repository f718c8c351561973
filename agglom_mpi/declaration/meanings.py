"""Meaning of the fields of a declaration, as its docstring states it under `Attributes`."""

import inspect
import re
from collections.abc import Mapping
from functools import cache
from typing import Any, Final

ATTRIBUTES: Final = re.compile(r"\n\nAttributes\n-+\n")
"""Heading of the part of a docstring that describes fields."""
_ENTRY: Final = re.compile(r"^(\w[\w, ]*)\n((?:    .*(?:\n|$)|\n(?=    ))*)", re.MULTILINE)


def meaning_of(section: type[Any], name: str) -> str:
    """Return what the docstrings of a class and its bases say of a field; empty if they do not."""
    for base in section.__mro__:
        found = _described(base).get(name)
        if found:
            return found
    text = section.model_fields[name].meaning
    return f"{text[:1].upper()}{text[1:]}." if text else ""


@cache
def _described(section: type[Any]) -> Mapping[str, str]:
    """Return the texts of the part `Attributes` of a class's own docstring, by name."""
    parts = ATTRIBUTES.split(inspect.cleandoc(section.__dict__.get("__doc__") or ""))
    found: dict[str, str] = {}
    for names, text in _ENTRY.findall(parts[1]) if len(parts) > 1 else ():
        found |= {name.strip(): " ".join(text.split()) for name in names.split(",")}
    return found
