"""The accuracy report on disc: one Markdown document, its figures and a CSV for every table."""

import os
import platform
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, NamedTuple

from agglom_mpi.accuracy.section import Section, Table
from agglom_mpi.report.drawing import write_drawing
from agglom_mpi.storage.files import replace_file
from agglom_mpi.version import __version__

NAME: Final = "report.md"


class Part(NamedTuple):
    """Sections under a common heading."""

    title: str
    sections: tuple[Section, ...]


class Header(NamedTuple):
    """What the report is of: its title, the command that made it, and facts on the run."""

    title: str
    command: str
    facts: tuple[str, ...]


def write_document(directory: Path, header: Header, parts: Sequence[Part]) -> Path:
    """Write `report.md` with its figures and CSV files into a directory; the document's path.

    Every file is whole under its name or not there.
    """
    for section in (section for part in parts for section in part.sections):
        for figure in section.figures:
            write_drawing(directory, figure)
        for table in section.tables:
            replace_file(directory / f"{table.name}.csv", table.frame.to_csv(index=False).encode())
    text = "\n".join(_lines(header, parts))
    replace_file(directory / NAME, text.encode())
    return directory / NAME


def _lines(header: Header, parts: Sequence[Part]) -> Iterator[str]:
    yield from (f"# {header.title}", "", f"`{header.command}`", "", *_list(header.facts))
    yield from ("## Conclusions", "")
    for part in parts:
        for section in part.sections:
            yield from (f"{section.title}:", "", *_list(section.conclusions))
    yield "Computed from the tables below, which are also in the CSV files beside this document."
    yield ""
    for number, part in enumerate(parts, 1):
        yield from (f"## Part {number}: {part.title}", "")
        for section in part.sections:
            yield from _section(section)
    yield from ("## Machine", "", *_list(machine()))


def _section(section: Section) -> Iterator[str]:
    yield from (f"### {section.title}", "", section.problem, "")
    yield from (f"**Reference.** {section.reference}", "", f"**Set-ups.** {section.setups}", "")
    for figure in section.figures:
        yield from (f"![{figure.caption}]({figure.name}.png)", "", f"*{figure.caption}*", "")
    for table in section.tables:
        if table.shown:
            yield from _table(table)
    yield from ("**Failures.**" + ("" if section.failures else " None."), "")
    yield from _list(section.failures)


def _table(table: Table) -> Iterator[str]:
    yield from (f"{table.caption} (`{table.name}.csv`)", "")
    yield "| " + " | ".join(column.heading for column in table.shown) + " |"
    yield "|" + "---|" * len(table.shown)
    for _, row in table.frame.iterrows():
        yield "| " + " | ".join(column.text(row).replace("|", "¦") for column in table.shown) + " |"
    yield ""


def _list(items: Any) -> Iterator[str]:
    lines = [f"- {item}" for item in items]
    yield from [*lines, ""] if lines else []


def machine() -> Iterator[str]:
    """Facts on the machine and the libraries that the report was made with."""
    from importlib.metadata import version

    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "h5py"))
    yield f"{_processor()}, {os.cpu_count()} processors, {platform.system()} {platform.machine()}"
    yield f"agglom_mpi {__version__}, Python {platform.python_version()}, {libraries}"
    yield f"made {datetime.now(UTC).date().isoformat()}"


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
