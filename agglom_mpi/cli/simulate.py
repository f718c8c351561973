"""`agglom simulate`: simulate one parameter string, or replay a recorded one."""

from typing import Any

import click

from agglom_mpi.cli.common import (
    ALLOW_CODE,
    JSON,
    PATH,
    SETTINGS,
    STRICT,
    examples,
    exit_with,
    say,
)
from agglom_mpi.file_kinds import is_hdf5


@click.command(
    epilog=examples(
        "agglom simulate jobs/accretion_2003.yaml --set density=6000 --samples 100",
        "agglom simulate accretion_2003.h5 --string 107 --sample 3",
        "agglom simulate jobs/accretion_2003.yaml --frames 100 --out run",
    )
)
@click.argument("source", type=PATH)
@SETTINGS
@click.option(
    "--samples", type=click.IntRange(1, 10**6), help="Number of samples to average.  [default: 10]"
)
@click.option(
    "--engine",
    help="Engine; replaces that of the scene: event, fixed, fixed:STEPS or adaptive. The event "
    "engine always cools exactly.",
)
@click.option("--experiment", metavar="NAME", help="Experiment of a campaign that has several.")
@click.option("--string", type=click.IntRange(0), help="String of FILE.h5 to replay.")
@click.option("--sample", type=click.IntRange(0), help="Sample to replay.")
@click.option(
    "--frames",
    type=click.IntRange(2, 10**5),
    help="Number of frames to record, of the first sample or of --sample.",
)
@click.option(
    "--out",
    type=PATH,
    metavar="DIR",
    help="Directory for the figures (PNG, SVG) and the ParaView file of that sample.",
)
@ALLOW_CODE
@STRICT
@JSON
@exit_with
def simulate(as_json: bool, samples: int | None, **options: Any) -> int:
    """Simulate one parameter string of CAMPAIGN.yaml, or replay one recorded in FILE.h5.

    A variable with a range takes the middle of it unless --set gives a value. --frames and --out
    write figures of one sample (its particles at up to 9 times, and its evolution) and all frames
    for ParaView. No existing file is overwritten.
    """
    frames = options["frames"]
    if (frames is None) != (options["out"] is None):
        raise click.UsageError("--frames F and --out DIR belong together")
    if options["strict"] and is_hdf5(options["source"]):
        raise click.UsageError("--strict is for CAMPAIGN.yaml")
    if options["sample"] is not None and samples is not None:
        raise click.UsageError("--sample is one sample, --samples are the first; give one of them")
    if frames is not None and samples is not None:
        raise click.UsageError("--frames shows one sample; choose it with --sample, not --samples")
    from agglom_mpi.report.simulate import SimulationRequest, simulate_string

    request = SimulationRequest(samples=samples or 10, **options)
    text, code = simulate_string(request, as_json, show=lambda line: say(line, error=True))
    say(text)
    return code
