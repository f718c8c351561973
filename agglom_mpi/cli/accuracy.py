"""`agglom accuracy`: measure error against run time."""

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
    exit_with,
    run_connected,
)


@click.command(
    epilog=examples(
        "agglom accuracy jobs/quickstart.yaml --quick --out accuracy",
        "mpirun -n 2 agglom accuracy jobs/accretion_2003.yaml --history accretion_2003.h5 "
        "--out study",
        "mpirun -n 2 agglom accuracy jobs/accuracy/answer_quick.yaml --answer --out answer",
        "agglom accuracy jobs/accretion_2003.yaml jobs/extremes --out maps --map collapse,heat",
    )
)
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@click.option("--out", "-o", required=True, metavar="DIR", help="Directory of the report.")
@click.option("--quick", is_flag=True, help="Use few set-ups and samples; takes under a minute.")
@SETTINGS
@click.option("--samples", type=click.IntRange(2, 10**6), help="Number of samples per set-up.")
@click.option(
    "--history", metavar="FILE.h5", help="Also re-estimate the best strings of this campaign file."
)
@click.option(
    "--answer",
    is_flag=True,
    help="Measure the error of whole searches against their cost; SOURCE is an answer study.",
)
@click.option(
    "--map",
    is_flag=False,
    flag_value="all",
    metavar="[PLANE,...]",
    help="Map where each method breaks, in the given planes or in all: softening, heat, collapse, "
    "masses, scale, impact, cooling.",
)
@MAX_WALLTIME
@QUIET
@DATABASE
@accept_code_change("a study")
@ALLOW_CODE
def accuracy(**options: Any) -> None:
    """Measure error against run time, and write a report with figures and tables.

    SOURCE is a scene or a campaign, or a directory of extreme scenes. For a scene or campaign,
    one setting at a time is varied (time steps, ensembles, box). Extreme scenes are run as they
    are and as published. A variable with a range takes the middle of it unless --set gives a
    value. With --map, the first SOURCE is mapped and all others are drawn as points on its maps,
    also the rows of published tables (TABLES.json).
    With --answer, SOURCE is the file of an answer study: a question, and settings of its search
    that are varied one by one.

    Started by mpirun, the command uses all ranks. A study that was stopped is continued by the
    same command.
    """
    if options["answer"]:
        _check_answer(options)
    elif options["map"] is not None and options["history"] is not None:
        raise click.UsageError("--history is for a study without --map")

    def run(world: Any) -> int:
        from agglom_mpi.accuracy.command import accuracy
        from agglom_mpi.accuracy.study import StudyOptions

        return accuracy(StudyOptions(**options), world)

    exit_with(run_connected)(run=run)


def _check_answer(options: dict[str, Any]) -> None:
    """Raise a UsageError if there are options that an answer study does not take."""
    others = ("quick", "settings", "samples", "history", "map")
    given = ["--set" if name == "settings" else f"--{name}" for name in others if options[name]]
    if given or len(options["sources"]) != 1:
        wrong = f"not {', '.join(given)}" if given else f"not {len(options['sources'])}"
        raise click.UsageError(f"--answer takes one file of a study, {wrong}")
