"""`agglom plan`: estimate the run time of a campaign."""

from typing import Any, Final

import click

from agglom_mpi.cli.common import (
    ALLOW_CODE,
    GENERATIONS,
    JSON,
    examples,
    exit_with,
    read_duration,
    say,
)
from agglom_mpi.errors import FAILURE

MOST_RANKS: Final = 10**6
"""Maximum number of ranks of a forecast."""
MOST_DIGITS: Final = 18
"""Maximum number of digits of a number of ranks; Python refuses to read some thousand."""


def _read_ranks(context: click.Context, parameter: click.Parameter, text: str) -> tuple[int, ...]:
    """Return the numbers of ranks of a text like `1,10,100`."""
    words = [word.strip() for word in text.split(",")]
    counts = [int(word) if word.isdecimal() and len(word) <= MOST_DIGITS else 0 for word in words]
    if not all(1 <= count <= MOST_RANKS for count in counts):
        allowed = f"allowed: numbers from 1 to {MOST_RANKS} like 1,10,100"
        raise click.BadParameter(f"{text!r} is no list of numbers of ranks; {allowed}")
    return tuple(counts)


@click.command(
    epilog=examples(
        "agglom plan jobs/agglomeration_2004.yaml --ranks 1,64,1024",
        "agglom plan jobs/accretion_2003.yaml --from accretion_2003.h5",
    )
)
@click.argument("path", metavar="CAMPAIGN")
@click.option(
    "--ranks",
    callback=_read_ranks,
    default="1,10,100,1000",
    show_default=True,
    metavar="N,N,...",
    help="Numbers of ranks to estimate for.",
)
@click.option(
    "--from",
    "source",
    metavar="FILE.h5",
    help="Use the samples of this campaign file instead of pilot samples; it may be unfinished.",
)
@click.option(
    "--seconds",
    callback=read_duration,
    default="20",
    show_default=True,
    metavar="TIME",
    help="Time to spend on pilot samples: 90, 5m, 1h.",
)
@GENERATIONS
@ALLOW_CODE
@JSON
@exit_with
def plan(as_json: bool, **options: Any) -> int:
    """Estimate the run time of CAMPAIGN.yaml for different numbers of ranks.

    Pilot samples of random strings are simulated in one process and timed. Then the decisions and
    the scheduler of the campaign run on simulated ranks, each as fast as a core of this machine.
    A file of a few generations, given by --from, makes the estimate better.

    Exit code 1 if an estimate would take too many samples.
    """
    from agglom_mpi.analysis.damage import blame_damage
    from agglom_mpi.display.run_display import print_wide
    from agglom_mpi.planning.forecast import forecast_table, to_json
    from agglom_mpi.planning.plan import plan

    origin = click.get_current_context().get_parameter_source("seconds")
    source = options["source"]
    if source is not None and origin is not click.core.ParameterSource.DEFAULT:
        raise click.UsageError("--seconds is for pilot samples; --from replaces them")
    with blame_damage(*filter(None, [source])):
        report = plan(**options)
    if as_json:
        say(to_json(report))
    else:
        print_wide(forecast_table(report))
    return FAILURE if report.not_forecast else 0
