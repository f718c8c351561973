"""`agglom doctor`: check the machine that is to run campaigns."""

from pathlib import Path

import click

from agglom_mpi.cli.common import examples, exit_with
from agglom_mpi.errors import FAILURE


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
    from agglom_mpi.doctor.checks import as_table, run_checks

    findings = list(run_checks(folder.resolve()))
    print_wide(as_table(findings))
    return FAILURE if any(finding.broken for finding in findings) else 0
