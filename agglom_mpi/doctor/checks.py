"""All checks of `agglom doctor`, in their order, and the table of what they find."""

from collections.abc import Iterator
from pathlib import Path

from rich.console import Group, RenderableType

from agglom_mpi.display.table import Facts
from agglom_mpi.doctor.folders import check_storage
from agglom_mpi.doctor.machine import (
    Finding,
    check_batch_system,
    check_libraries,
    check_nodes,
    check_processors,
)
from agglom_mpi.doctor.ranks import check_mpi, check_shared_memory


def run_checks(folder: Path) -> Iterator[Finding]:
    """Yield the findings of all checks; `folder` is that of the campaign files."""
    yield from check_libraries()
    yield from check_mpi()
    yield from check_shared_memory()
    yield from check_nodes()
    yield from check_processors()
    yield from check_storage(folder)
    yield from check_batch_system()


def as_table(findings: list[Finding]) -> RenderableType:
    """Return a table of findings with the advice below."""
    marks = ("✗" if each.broken else "!" if each.advice else " " for each in findings)
    rows = [(f"{m} {each.topic}", each.found) for m, each in zip(marks, findings, strict=True)]
    advice = [f"{finding.topic}: {finding.advice}" for finding in findings if finding.advice]
    return Group(Facts(rows), "", *(advice or ["nothing to change"]))
