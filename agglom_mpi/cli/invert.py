"""`agglom-invert`: run a campaign."""

import sys
from typing import Any

import click

from agglom_mpi.cli.common import (
    ALLOW_CODE,
    DATABASE,
    GENERATIONS,
    HELP,
    MAX_WALLTIME,
    QUIET,
    STRICT,
    accept_code_change,
    examples,
    run_connected,
)
from agglom_mpi.version import __version__


@click.command(
    "agglom-invert",
    epilog=examples("mpirun -n 2 agglom-invert jobs/accretion_2003.yaml"),
    context_settings=HELP,
)
@click.argument("campaign")
@click.option(
    "--output",
    "-o",
    metavar="FILE.h5",
    help="Campaign file to write. [default: stem of CAMPAIGN + .h5]",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    metavar="N",
    help="Seed; replaces that of the campaign. The file is then called STEM_seedN.h5.",
)
@GENERATIONS
@MAX_WALLTIME
@QUIET
@DATABASE
@accept_code_change("a file")
@click.option(
    "--accept-new-data",
    is_flag=True,
    help="Compare the samples of the file with other data, at times that it has censuses of.",
)
@ALLOW_CODE
@STRICT
@click.version_option(__version__)
def invert_command(**options: Any) -> None:
    """Run the campaign of the YAML file CAMPAIGN, or continue it.

    Started by mpirun, the command uses all ranks; otherwise it uses one process. Ctrl-C, the
    signals TERM, USR1 and HUP, and --max-walltime stop a run cleanly; the same command continues
    it.

    Exit codes: 0 finished; 2 bad input; 75 stopped early; 1 any other failure.
    """

    def run(world: Any) -> int:
        from agglom_mpi.runtime.invert import InvertOptions, invert

        return invert(InvertOptions(**options), world)

    sys.exit(run_connected(run))
