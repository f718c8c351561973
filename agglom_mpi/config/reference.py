"""Tables of what a campaign file can name, derived from the classes of the components."""

import inspect
from collections.abc import Iterator
from typing import Final

from agglom_mpi.config.document import CampaignDocument
from agglom_mpi.config.explanation import (
    Path,
    below,
    limits_of,
    needed_by,
    texts_of,
    topics,
    value_text,
)
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.declaration.choices import choice_of
from agglom_mpi.declaration.components import Component, number_of
from agglom_mpi.declaration.declared import DeclaredField
from agglom_mpi.search.ending import EndingCriterion

SECTIONS: Final = (("scene", SceneSection), ("", CampaignDocument))
"""Sections whose fields are chosen among components, with what stands before their keys."""


def component_kinds() -> dict[str, type[Component]]:
    """Return the kinds of components by their keys in a campaign file, as `scene.restitution`."""
    kinds: dict[str, type[Component]] = {}
    for prefix, section in SECTIONS:
        for key, field in section.model_fields.items():
            if choice := choice_of(field):
                kinds[f"{prefix}.{key}" if prefix else key] = choice.kind
    return kinds | {"stopping": EndingCriterion}


def component_tables() -> str:
    """Return a Markdown table of each kind of component: names, keys, and what each one is."""
    return "\n".join(_table(key, kind) for key, kind in component_kinds().items())


def section_tables() -> str:
    """Return a Markdown table of the keys of each section, and of each mapping of a component."""
    sections = [(), *(path for path, topic in topics().items() if not topic.example)]
    # Keys stand below the others, and not components.
    with_keys = (path for path in sections if any(not topic.example for topic in below(path)))
    tables = map(_section_table, with_keys)
    return "\n".join(dict.fromkeys(tables))  # racing is the same of several rules


def _section_table(path: Path) -> str:
    name = f"`{path[-1]}`" if path else "at the top"
    rows = [f"| {name} | allowed | default | |", "|---|---|---|---|"]
    for topic in below(path):
        default = "**must be given**" if topic.default is None else topic.default
        cells = (f"`{topic.path[-1]}`", topic.allowed, default, topic.meaning.replace("|", "\\|"))
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join([*rows, ""])


def _table(key: str, kind: type[Component]) -> str:
    rows = [f"| `{key}` | keys | |", "|---|---|---|"]
    for name, component in kind.components().items():
        keys = "; ".join(_keys(component))
        rows.append(f"| `{name}` | {keys} | {_statement(component)}{_needs(component)} |")
    return "\n".join([*rows, ""])


def _needs(component: type[Component]) -> str:
    """Return the variables that a law needs, in words."""
    names = [f"`{name}`" for name in needed_by(component)]
    return f" Needs {', '.join(names)}." if names else ""


def _statement(component: type[Component]) -> str:
    """Return the first line of a component's docstring, as a cell of a table."""
    first = (inspect.getdoc(component) or "").split("\n\n")[0]
    return first.replace("\n", " ").replace("  [", " [").replace("|", "\\|")


def _keys(component: type[Component]) -> Iterator[str]:
    for name, field in component.model_fields.items():
        if name not in (component.named_by, *component.not_in_files):
            words = [f"`{name}`", *_allowed(field), *_default(field)]
            yield " ".join(words)


def _allowed(field: DeclaredField) -> Iterator[str]:
    """Yield the limits and the unit of a field, or the texts that it can have."""
    number = number_of(field)
    if number is not None:
        yield from limits_of(number)
        if number.unit != "1":
            yield number.unit
    elif choice_of(field):
        yield "any of these"
    elif texts := texts_of(field.annotation):
        yield " or ".join(f"`{text}`" for text in texts)


def _default(field: DeclaredField) -> Iterator[str]:
    """Yield the default of a field in brackets, if it has one that can be written."""
    if text := value_text(field.default):
        yield f"(`{text}`)" if isinstance(field.default, bool | str) else f"({text})"
