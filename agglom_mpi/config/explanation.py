"""Meaning of every key of a campaign file, derived from the declarations of its sections.

The text on a key is what the docstring of its class says of it, under `Attributes`; that on a
component is the docstring itself.
"""

import inspect
import re
import sys
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cache
from typing import Any, Final, Literal, NamedTuple, TypeAlias, get_args, get_origin

from agglom_mpi.config.document import CampaignDocument
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.declaration.choices import choice_of
from agglom_mpi.declaration.components import Component, In, Whole, number_of
from agglom_mpi.declaration.declared import ATTRIBUTES, Declared, declared_in, meaning_of
from agglom_mpi.declaration.laws import Law
from agglom_mpi.errors import UserError
from agglom_mpi.search.ending import EndingCriterion
from agglom_mpi.variables import PAPER_VARIABLES, VOLUME_FRACTION, Variable

Path: TypeAlias = tuple[str, ...]

_REFERENCE: Final = """\
# Reference of the campaign file: the output of `agglom explain --markdown`

Numbers are in SI units, or carry any unit of the same dimension (`67 MPa`).

## Keys of each section

{sections}
## Laws, objectives, searches and rules

The limits of a number are followed by its SI unit and, in brackets, its default. `v⁰`, `H₀`, `μ₀` \
and `θ₀` are the variables `relative_speed`, `hardness`, `friction` and `temperature`; [A] and [B] \
are the papers of 2003 and 2004.

{components}"""
"""Reference in Markdown, without its tables."""
_SOURCE: Final = re.compile(r"^\[(\w+)\] +(.+(?:\n .+)*)", re.MULTILINE)


class UnknownKeyError(UserError, ValueError):
    """A campaign file has no key of this name."""


class Topic(NamedTuple):
    """An entry of the reference: on a section, a key, a component or a variable.

    Attributes
    ----------
    path
        Keys from the top of the file; a component stands below its key.
    meaning
        One or more sentences.
    allowed
        Limits, unit and texts that a value can have; empty if keys follow.
    default
        Value where a file has none; None if it must be given.
    further
        Paragraphs on a component: its formula, its source, when to use it, what it leaves out.
    needs
        Variables that a component needs.
    example
        Smallest entry of a file that has it; empty of what is no component.
    """

    path: Path
    meaning: str
    allowed: str = ""
    default: str | None = ""
    further: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    example: str = ""


@cache
def topics() -> Mapping[Path, Topic]:
    """Return all topics, each section before its keys."""
    return {topic.path: topic for topic in _topics_of(CampaignDocument, ())}


def below(path: Path) -> list[Topic]:
    """Return the topics one step below a path."""
    return [topic for topic in topics().values() if topic.path[:-1] == path]


def find(words: str) -> list[Topic]:
    """Return the topics that some keys name: `cooling.emissivity`, or `density`.

    Keys between may be left out, and those before the first. A path that is whole is the only one.

    Raises
    ------
    UnknownKeyError
        If there is none, with what is near.
    """
    wanted = tuple(words.split("."))
    for whole in (wanted, ("scene", *wanted), ("variables", words)):
        if whole in topics():
            others = [topic for topic in below(("variables",)) if topic.path[-1:] == wanted]
            return list(dict.fromkeys([topics()[whole], *others]))
    found = [topic for topic in topics().values() if _is_among(wanted, topic.path)]
    if not found:
        known = dict.fromkeys(path[-1] for path in topics())
        near = get_close_matches(wanted[-1], known, n=1)
        advice = f"did you mean '{near[0]}'?" if near else "`agglom explain` lists the sections"
        raise UnknownKeyError(f"{words}: no key of a campaign file; {advice}")
    return found


def _is_among(wanted: Path, path: Path) -> bool:
    """Return whether a path ends with a key, and has those before it in their order."""
    if wanted[-1] != path[-1]:
        return False
    rest = iter(path)
    return all(key in rest for key in wanted)


def _topics_of(section: type[Any], path: Path) -> Iterator[Topic]:
    """Yield the topics of the keys of a section or component, and of what is below them."""
    hidden = (section.named_by, *section.not_in_files) if issubclass(section, Component) else ()
    for name, field in section.model_fields.items():
        here = (*path, name)
        if here == ("variables",):
            yield Topic(here, meaning_of(section, name), default=None)
            yield from (_variable(variable) for variable in (*PAPER_VARIABLES, VOLUME_FRACTION))
        elif choice := choice_of(field):
            allowed = f"as `{path[-2]}`" if choice.is_inner else ""
            yield Topic(here, meaning_of(section, name), allowed, _default(section, name))
            if not choice.is_inner:
                yield from _components(choice.kind, here)
        elif name not in hidden:
            yield from _key(section, here)


def _key(section: type[Any], path: Path) -> Iterator[Topic]:
    """Yield the topic of a key that chooses no component, and those of the keys below it."""
    name = path[-1]
    field = section.model_fields[name]
    meaning, default = meaning_of(section, name), _default(section, name)
    inner = next(declared_in(field.annotation), None)
    if inner is not None and issubclass(inner, EndingCriterion):
        meaning = _paragraphs(inner)[0]
        if list(inner.model_fields) == [name]:
            yield Topic(path, meaning, _allowed(inner, name), default)
            return
    yield Topic(path, meaning, "" if inner else _allowed(section, name), default)
    if inner is not None:
        yield from _topics_of(inner, path)


def _components(kind: type[Component], path: Path) -> Iterator[Topic]:
    for name, component in kind.components().items():
        first, *further = _paragraphs(component)
        alone = name if kind.named_by == "law" else f"{{{kind.named_by}: {name}}}"
        example = f"{path[-1]}: {component.example or alone}"
        needs = (*component.variables, *component.needs) if issubclass(component, Law) else ()
        yield Topic((*path, name), first, further=tuple(further), needs=needs, example=example)
        yield from _topics_of(component, (*path, name))


def _variable(variable: Variable) -> Topic:
    unit = "" if variable.unit == "1" else f" {variable.unit}"
    allowed = f"a value, [lower, upper] or [lower, upper, log]{unit}"
    meaning = variable.meaning[:1].upper() + variable.meaning[1:]
    return Topic(("variables", variable.name), f"{meaning}.", allowed)


def _paragraphs(component: type[Component]) -> list[str]:
    text = ATTRIBUTES.split(inspect.getdoc(component) or component.__name__)[0]
    paragraphs = [*text.split("\n\n"), *_sources(component, text)]
    return [" ".join(paragraph.split()) for paragraph in paragraphs]


def _sources(component: type[Component], text: str) -> Iterator[str]:
    """Yield the sources that a text cites, as the docstring of the component's module has them."""
    module = inspect.cleandoc(sys.modules[component.__module__].__doc__ or "")
    for label, source in _SOURCE.findall(module):
        if f"[{label}]" in text:
            yield f"[{label}] {source}"


def _allowed(section: type[Any], name: str) -> str:
    """Return limits, unit and texts of a value."""
    field = section.model_fields[name]
    own = getattr(section, "NUMBERS", {}).get(name)
    number = own or number_of(field) or _number_within(field.annotation)
    words = [_limits(number)] if number else []
    words += [f"`{text}`" for text in texts_of(field.annotation)]
    if number is not None and number.unit != "1":
        words[:1] = [" ".join([*words[:1], number.unit])]
    if field.annotation is bool:
        words = ["true", "false"]
    elif not words and get_origin(field.annotation) is tuple:
        words = ["a list"]
    return " or ".join(words)


def _number_within(annotation: Any) -> In | Whole | None:
    for inner in (annotation, *getattr(annotation, "__args__", ())):
        for each in getattr(inner, "__metadata__", ()):
            if isinstance(each, In | Whole):
                return each
    return None


def _default(section: type[Any], name: str) -> str | None:
    """Return the value of a key that is not given, as in a file; None if it must be."""
    field = section.model_fields[name]
    supplied: Mapping[str, str] = getattr(section, "SUPPLIED", {})
    if name in supplied:
        return supplied[name]
    if field.is_required():
        return None
    default = field.default
    if default is None:
        return "none"
    if isinstance(default, Component):
        return default.name or "as below"
    text = value_text(default)
    if text is None:
        return "as below"
    return f"[{text}]" if text and isinstance(default, tuple) else text or "none"


def value_text(value: Any) -> str | None:
    """Return a plain value as a file has it, a list without brackets; None of other values."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return ", ".join(f"{each:g}" for each in value)
    if isinstance(value, int | str):
        return str(value)
    return f"{value:g}" if isinstance(value, float) else None


def _limits(number: In | Whole) -> str:
    bounds = [
        f"{sign} {bound:,}" if isinstance(bound, int) else f"{sign} {bound:g}"
        for sign, bound in zip((">", "≥", "≤", "<"), number.limits, strict=True)
        if bound is not None and bound < sys.maxsize
    ]
    kind = "whole number" if isinstance(number, Whole) else "number"
    return " ".join(filter(None, [kind, ", ".join(bounds)]))


def texts_of(annotation: Any) -> tuple[str, ...]:
    """Return the texts of a Literal, also where it is part of a union."""
    if get_origin(annotation) is Literal:
        return tuple(text for text in get_args(annotation) if isinstance(text, str))
    return tuple(text for inner in get_args(annotation) for text in texts_of(inner))


def component_kinds() -> dict[Path, type[Component]]:
    """Return the kinds of components by their paths in a campaign file: `scene`, `restitution`."""
    sections: dict[Path, type[Declared]] = {("scene",): SceneSection, (): CampaignDocument}
    kinds: dict[Path, type[Component]] = {
        (*path, key): choice.kind
        for path, section in sections.items()
        for key, field in section.model_fields.items()
        if (choice := choice_of(field))
    }
    return kinds | {("stopping",): EndingCriterion}


def reference_page() -> str:
    """Return the page in Markdown that lists every key and component: `jobs/REFERENCE.md`."""
    page = _REFERENCE.format(sections=section_tables(), components=component_tables())
    return page.removesuffix("\n")


def component_tables() -> str:
    """Return a Markdown table of each kind of component: names, keys, and what each one is."""
    return "\n".join(map(_component_table, component_kinds()))


def _component_table(path: Path) -> str:
    rows = [f"| `{'.'.join(path)}` | keys | |", "|---|---|---|"]
    for topic in below(path):
        if topic.example or (
            path == ("stopping",) and topic.path[-1] in EndingCriterion.components()
        ):
            keys = "; ".join(map(_key_text, below(topic.path))) or topic.allowed
            needs = f" Needs {', '.join(f'`{name}`' for name in topic.needs)}." * bool(topic.needs)
            rows.append(f"| `{topic.path[-1]}` | {keys} | {_cell(topic.meaning)}{needs} |")
    return "\n".join([*rows, ""])


def _key_text(topic: Topic) -> str:
    allowed = topic.allowed.removeprefix("whole ").removeprefix("number").strip()
    default = f"({topic.default})" if topic.default not in (None, "", "none", "as below") else ""
    return " ".join(filter(None, (f"`{topic.path[-1]}`", allowed, default)))


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


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
        cells = (f"`{topic.path[-1]}`", topic.allowed, default, _cell(topic.meaning))
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join([*rows, ""])
