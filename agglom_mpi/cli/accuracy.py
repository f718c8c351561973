"""`agglom accuracy`: measure error against run time."""

import sys
from typing import Any

import click

from agglom_mpi.cli.common import (
    ALLOW_CODE,
    DATABASE,
    MAX_WALLTIME,
    QUIET,
    SETTINGS,
    accept_code_change,
    examples,
    run_connected,
)


@click.command(
    epilog=examples(
        "agglom accuracy jobs/quickstart.yaml --quick --out accuracy",
        "mpirun -n 2 agglom accuracy jobs/accretion_2003.yaml --history accretion_2003.h5 "
        "--out study",
        "agglom accuracy jobs/accretion_2003.yaml jobs/extremes --out maps --map collapse,heat",
    )
)
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@click.option("--out", "-o", required=True, metavar="DIR", help="Directory of the report.")
@click.option("--quick", is_flag=True, help="Few set-ups and samples: under a minute.")
@SETTINGS
@click.option("--samples", type=click.IntRange(2, 10**6), help="Samples of each set-up.")
@click.option(
    "--history", metavar="FILE.h5", help="Also re-estimate the best strings of this campaign file."
)
@click.option(
    "--map",
    is_flag=False,
    flag_value="all",
    metavar="[PLANE,...]",
    help="Map where each method breaks, in these planes or in all: softening, heat, collapse, "
    "masses, scale; impact and cooling laws alone.",
)
@MAX_WALLTIME
@QUIET
@DATABASE
@accept_code_change("a study")
@ALLOW_CODE
def accuracy(**options: Any) -> None:
    """Measure error against run time, and write a report with figures and tables.

    SOURCE is a scene or campaign, of which one setting at a time is varied (time steps, impact
    solver, cooling, ensembles, box), or a directory of extreme scenes, which are run as they are
    and as published. Variables that are ranges and not --set take the middle of their range.
    With --map the first scene is mapped, and all others are points on its maps. Started by mpirun
    it uses all ranks; run again, it goes on.
    """

    def run(world: Any) -> int:
        from agglom_mpi.accuracy.command import AccuracyOptions, accuracy
        from agglom_mpi.accuracy.map_command import map_accuracy

        asked = AccuracyOptions(**options)
        return accuracy(asked, world) if asked.map is None else map_accuracy(asked, world)

    sys.exit(run_connected(run))
