"""`agglom simulate`: simulate one parameter string, or a recorded one again."""

from pathlib import Path

import click

from agglom_mpi.cli.launch import exits
from agglom_mpi.cli.options import ALLOW_CODE, JSON, PATH, SETTINGS, examples


@click.command(
    epilog=examples(
        "agglom simulate jobs/accretion_2003.yaml --set density=6000 --samples 100",
        "agglom simulate accretion_2003.h5 --string 107 --sample 3",
        "agglom simulate jobs/accretion_2003.yaml --frames 100 --out run",
    )
)
@click.argument("source")
@SETTINGS
@click.option("--samples", type=click.IntRange(1), help="Samples to average.  [default: 10]")
@click.option(
    "--engine",
    help="event, fixed, fixed:STEPS or adaptive, instead of the scene's own; event cools exactly, "
    "also where the scene says euler.",
)
@click.option("--string", type=click.IntRange(0), help="Replay this string of a campaign file.")
@click.option("--sample", type=click.IntRange(0), help="Replay this one sample.")
@click.option(
    "--frames",
    type=click.IntRange(2),
    help="Number of frames to take of one sample, the first or --sample.",
)
@click.option(
    "--out",
    type=PATH,
    metavar="DIR",
    help="Directory of its figures, PNG and SVG, and of its file for ParaView.",
)
@ALLOW_CODE
@JSON
@exits
def simulate(
    source: str,
    settings: dict[str, float | str],
    samples: int | None,
    engine: str | None,
    string: int | None,
    sample: int | None,
    frames: int | None,
    out: Path | None,
    allow_code: bool,
    as_json: bool,
) -> int:
    """Simulate one parameter string forward, of CAMPAIGN.yaml or as recorded in FILE.h5.

    Variables that are ranges and not --set take the middle of their range. --frames and --out show
    one sample: its particles at successive times (9 of them at most), how it evolves, and all
    frames as a file for ParaView; no existing file is overwritten.
    """
    if (frames is None) != (out is None):
        raise click.UsageError("--frames F and --out DIR belong together")
    if frames is not None and samples is not None:
        raise click.UsageError("--frames shows one sample; choose it with --sample, not --samples")
    from agglom_mpi.report.simulate import SimulationRequest, simulate_string

    request = SimulationRequest(
        source=Path(source),
        settings=settings,
        samples=samples or 10,
        engine=engine,
        string=string,
        sample=sample,
        allow_code=allow_code,
        frames=frames,
        out=out,
    )
    text, code = simulate_string(request, as_json)
    click.echo(text)
    return code
