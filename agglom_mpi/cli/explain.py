"""`agglom explain`: what the keys of a campaign file mean."""

import shutil
import sys
import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import click

from agglom_mpi.cli.common import examples, exit_with, say
from agglom_mpi.errors import UserError

if TYPE_CHECKING:
    from agglom_mpi.config.explanation import Topic

WIDTH: Final = 100
"""Maximum number of columns of a line in a wider terminal."""
LEAST_TEXT: Final = 30
"""Minimum number of columns of a text beside its name, however narrow the terminal."""
MOST_PAGES: Final = 2
"""Number of topics of one name that are explained one by one; more are listed."""
INDENT: Final = "  "


@click.command(
    epilog=examples(
        "agglom explain",
        "agglom explain restitution",
        "agglom explain cooling.emissivity density",
        "agglom explain --markdown > REFERENCE.md",
    )
)
@click.argument("keys", nargs=-1, metavar="[KEY ...]")
@click.option("--markdown", is_flag=True, help="Print all keys and laws as a page in Markdown.")
@exit_with
def explain(keys: tuple[str, ...], markdown: bool) -> int:
    """Explain the KEYs of a campaign file: meaning, allowed values, default.

    A KEY is a section (final), a key of the scene (restitution), a law (restitution.constant), a
    number (cooling.emissivity) or a variable (density). Without a KEY, the sections are listed.
    """
    if sys.flags.optimize > 1:
        raise UserError("agglom explain: python -OO removes the texts; run python without -OO")
    from agglom_mpi.config.explanation import below, find, reference_page

    pages = [page for key in keys for page in _pages(find(key))]
    if markdown:
        say(reference_page())
    elif not keys:
        sections = below(())
        pages = [[*_table(sections), "", "`agglom explain SECTION` lists the keys of a section."]]
    if pages:
        say("\n\n".join("\n".join(page) for page in pages))
    return 0


def _pages(found: "list[Topic]") -> Iterator[list[str]]:
    """Yield the lines on each of some topics, or a list of them if they are many."""
    if len(found) > MOST_PAGES:
        yield list(_table(found, whole=True))
    else:
        yield from ([*_page(topic)] for topic in found)


def _page(topic: "Topic") -> Iterator[str]:
    """Yield the lines on one topic."""
    from agglom_mpi.config.explanation import below

    yield ".".join(topic.path)
    for paragraph in (topic.meaning, *topic.further):
        yield from _wrapped(paragraph, INDENT, INDENT)
    facts = {
        "allowed": topic.allowed.replace("`", ""),
        "default": "none: it must be given" if topic.default is None else topic.default,
        "needs": ", ".join(topic.needs),
        "example": topic.example,
    }
    given = {name: text for name, text in facts.items() if text}
    if given:
        yield ""
        for name, text in given.items():
            first, later = f"{INDENT}{name:8s} ", INDENT + " " * 9
            yield from _wrapped(text, first, later)
    if keys := below(topic.path):
        yield ""
        yield from _table(keys)
    if any(key.example for key in keys):
        yield ""
        law = ".".join(keys[0].path[-2:])
        yield f"`agglom explain {law}` gives formula, numbers and an example."


def _table(topics: "list[Topic]", *, whole: bool = False) -> Iterator[str]:
    """Yield a line or more on each topic: its name, what it is, what it may be."""
    names = [".".join(topic.path) if whole else topic.path[-1] for topic in topics]
    width = max(map(len, names)) + 2
    for name, topic in zip(names, topics, strict=True):
        default = "must be given" if topic.default is None else f"default {topic.default}"
        facts = [topic.allowed.replace("`", ""), default if topic.default != "" else ""]
        shown = "; ".join(fact for fact in facts if fact)
        text = f"{topic.meaning} ({shown})" if shown else topic.meaning
        indent = INDENT + " " * width
        lines = _wrapped(text, indent, indent)
        yield f"{INDENT}{name:{width}s}{lines[0].strip()}"
        yield from lines[1:]


def _wrapped(text: str, first: str, later: str) -> list[str]:
    """Return the lines of a text, indented, as wide as the terminal."""
    columns = shutil.get_terminal_size((WIDTH, 24)).columns
    width = max(min(columns, WIDTH), len(later) + LEAST_TEXT)
    return textwrap.wrap(text, width, initial_indent=first, subsequent_indent=later)
