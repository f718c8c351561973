"""`agglom export`: compact copy, CSV tables and ParaView files of a campaign file."""

from pathlib import Path

import click

from agglom_mpi.cli.common import ALLOW_CODE, PATH, examples, exit_with, say


@click.command(
    epilog=examples(
        "agglom export accretion_2003.h5 --compact accretion_2003_compact.h5",
        "agglom export accretion_2003.h5 --csv tables",
        "agglom export accretion_2003.h5 --paraview best.vtkhdf",
    )
)
@click.argument("file")
@click.option("--compact", type=PATH, metavar="OUT.h5", help="Write a compressed copy of the file.")
@click.option(
    "--csv",
    type=PATH,
    metavar="DIR",
    help="Write strings.csv, samples.csv, estimates.csv and generations.csv.",
)
@click.option(
    "--paraview",
    type=PATH,
    metavar="OUT.vtkhdf",
    help="Write the particles of a sample over time for ParaView. Several samples get one file "
    "each, OUT_STRING_SAMPLE.vtkhdf.",
)
@click.option("--string", type=click.IntRange(0), help="String to write.  [default: the best]")
@click.option(
    "--sample",
    "samples",
    type=click.IntRange(0),
    multiple=True,
    help="Sample to write; may be repeated.  [default: all with stored frames, or the first]",
)
@click.option(
    "--frames",
    type=click.IntRange(1, 10**5),
    help="Resimulate the sample with this number of frames.  [default: those stored, or 101]",
)
@ALLOW_CODE
@exit_with
def export(
    file: str,
    compact: Path | None,
    csv: Path | None,
    paraview: Path | None,
    string: int | None,
    samples: tuple[int, ...],
    frames: int | None,
    allow_code: bool,
) -> int:
    """Export a campaign FILE.h5: give one or more of --compact, --csv and --paraview.

    All complete rows are exported, also while a run is writing. No existing file is overwritten. A
    sample without stored frames is simulated again, with identical results.
    """
    if compact is None and csv is None and paraview is None:
        message = "nothing to write: give --compact OUT.h5, --csv DIR or --paraview OUT.vtkhdf"
        raise click.UsageError(message)
    if paraview is None and (string is not None or samples or frames is not None):
        raise click.UsageError("--string, --sample and --frames are for --paraview OUT.vtkhdf")
    from agglom_mpi.analysis.damage import blame_damage
    from agglom_mpi.report.export import export

    selection = None
    if paraview is not None:
        from agglom_mpi.report.paraview import FrameSelection

        selection = FrameSelection(paraview, string, samples, frames)
    with blame_damage(file):
        for line in export(Path(file), compact, csv, selection, allow_code):
            say(line)
    return 0
