"""`agglom doctor`: what this machine has to run campaigns with."""

from pathlib import Path

import click

from agglom_mpi.cli.launch import exits
from agglom_mpi.cli.options import examples
from agglom_mpi.exit_codes import FAILURE


@click.command(epilog=examples("agglom doctor", "agglom doctor /tmp"))
@click.argument(
    "folder", type=click.Path(exists=True, file_okay=False, path_type=Path), default="."
)
@exits
def doctor(folder: Path) -> int:
    """Tell what this machine has to run campaigns with, and what to mend.

    MPI and its launcher, HDF5, compiled kernels, processors, the file system of FOLDER, the batch
    system. Exit code 1 if campaigns do not run like this on several ranks.
    """
    from agglom_mpi.display.display import print_wide
    from agglom_mpi.doctor import as_table, run_checks

    findings = list(run_checks(folder.resolve()))
    print_wide(as_table(findings))
    return FAILURE if any(finding.broken for finding in findings) else 0
