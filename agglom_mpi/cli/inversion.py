"""`agglom-invert`: run a campaign."""

import sys
from typing import Any

import click

from agglom_mpi.cli.launch import connected
from agglom_mpi.cli.options import (
    ALLOW_CODE,
    DATABASE,
    GENERATIONS,
    MAX_WALLTIME,
    QUIET,
    accept_code_change,
    examples,
)
from agglom_mpi.version import __version__


@click.command(
    "agglom-invert",
    epilog=examples("mpirun -n 2 agglom-invert jobs/accretion_2003.yaml"),
    context_settings={"max_content_width": 100},
)
@click.argument("campaign")
@click.option(
    "--output", "-o", metavar="FILE.h5", help="Campaign file [default: CAMPAIGN's stem.h5]."
)
@GENERATIONS
@MAX_WALLTIME
@QUIET
@DATABASE
@accept_code_change("a file")
@ALLOW_CODE
@click.version_option(__version__)
def invert_command(**options: Any) -> None:
    """Run the inversion that CAMPAIGN (a YAML file) describes, or continue it.

    Started by mpirun it uses all ranks; without, this process. Exit codes: 0 finished, 2 bad input,
    75 stopped early (signal or --max-walltime; run the same command again), 1 anything else.
    """

    def run(world: Any) -> int:
        from agglom_mpi.runtime.run import Options, invert

        return invert(Options(**options), world)

    sys.exit(connected(run))
