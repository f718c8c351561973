"""`agglom doctor`: check the machine that is to run campaigns."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from agglom_mpi.cli.common import examples, exit_with
from agglom_mpi.errors import FAILURE

if TYPE_CHECKING:
    from rich.console import Group

    from agglom_mpi.doctor.machine import Finding


@click.command(epilog=examples("agglom doctor", "agglom doctor /tmp"))
@click.argument(
    "folder", type=click.Path(exists=True, file_okay=False, path_type=Path), default="."
)
@exit_with
def doctor(folder: Path) -> int:
    """Check whether this machine can run campaigns, and advise what to change.

    The checks cover libraries, MPI and its launcher, processors, the file system of FOLDER, the
    cache of compiled kernels and the batch system. Exit code 1 if campaigns cannot run on several
    ranks.
    """
    from agglom_mpi.display.run_display import print_wide

    findings = list(run_checks(folder.resolve()))
    print_wide(as_table(findings))
    return FAILURE if any(finding.broken for finding in findings) else 0


def run_checks(folder: Path) -> "Iterator[Finding]":
    """Yield the findings of all checks; `folder` is that of the campaign files."""
    from agglom_mpi.doctor import machine, ranks

    yield from machine.check_libraries()
    yield from ranks.check_mpi()
    yield from ranks.check_shared_memory()
    yield from machine.check_nodes()
    yield from machine.check_processors()
    yield from machine.check_storage(folder)
    yield from machine.check_batch_system()


def as_table(findings: "list[Finding]") -> "Group":
    """Return a table of findings with the advice below."""
    from rich.console import Group

    from agglom_mpi.display.table import Facts

    marks = ("✗" if each.broken else "!" if each.advice else " " for each in findings)
    rows = [(f"{m} {each.topic}", each.found) for m, each in zip(marks, findings, strict=True)]
    advice = [f"{finding.topic}: {finding.advice}" for finding in findings if finding.advice]
    return Group(Facts(rows), "", *(advice or ["nothing to change"]))
