"""All that `agglom doctor` looks at, as a table."""

from collections.abc import Iterator
from pathlib import Path

from rich.console import Group, RenderableType
from rich.table import Table

from agglom_mpi.doctor import batch, libraries, processors, ranks, storage
from agglom_mpi.doctor.finding import Finding


def examine(folder: Path) -> Iterator[Finding]:
    """Look at everything: libraries, MPI, processors, where files go, the batch system."""
    yield from libraries.look()
    yield from ranks.look()
    yield from processors.look()
    yield from storage.look(folder)
    yield from batch.look()


def in_words(findings: list[Finding]) -> RenderableType:
    """Tabulate what was found, and below what to do."""
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for finding in findings:
        mark = "✗" if finding.broken else "!" if finding.advice else " "
        table.add_row(f"{mark} {finding.topic}", finding.found)
    advice = [f"{finding.topic}: {finding.advice}" for finding in findings if finding.advice]
    return Group(table, "", *(advice or ["nothing to mend"]))
