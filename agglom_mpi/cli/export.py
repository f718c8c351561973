"""`agglom export`: a campaign file as a compact copy, CSV, netCDF, JSON and for ParaView."""

from pathlib import Path
from typing import Final

import click

from agglom_mpi.cli.common import ALLOW_CODE, PATH, UNUSED, examples, exit_with, say
from agglom_mpi.cli.set_options import read_set_request, set_options

FORMS: Final = (
    *("--compact OUT.h5", "--csv DIR", "--xarray OUT.nc", "--arviz OUT.nc"),
    *("--json OUT.json", "--paraview OUT.vtkhdf"),
)
"""Options that write something, as messages show them."""


@click.command(
    epilog=examples(
        "agglom export accretion_2003.h5 --compact accretion_2003_compact.h5",
        "agglom export accretion_2003.h5 --csv tables",
        "agglom export accretion_2003.h5 --paraview best.vtkhdf",
        "agglom export accretion_2003.h5 --arviz draws.nc --measured 2 --error 2%",
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
    "--xarray",
    type=PATH,
    metavar="OUT.nc",
    help="Write strings and samples as netCDF with the dimensions string and sample.",
)
@click.option(
    "--arviz",
    type=PATH,
    metavar="OUT.nc",
    help="Write 4000 draws of equal weight for ArviZ: of the posterior if the campaign has data or "
    "with --measured, or else members of the feasible set.",
)
@click.option(
    "--json",
    "as_json",
    type=PATH,
    metavar="OUT.json",
    help="Write the posterior of all data with its calibration; without data, the feasible set.",
)
@set_options("--arviz or --json")
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
@UNUSED
@ALLOW_CODE
@exit_with
def export(
    file: str,
    compact: Path | None,
    csv: Path | None,
    xarray: Path | None,
    arviz: Path | None,
    as_json: Path | None,
    tolerance: str | None,
    measured: str | None,
    error: str | None,
    paraview: Path | None,
    string: int | None,
    samples: tuple[int, ...],
    frames: int | None,
    unused: bool,
    allow_code: bool,
) -> int:
    """Export a campaign FILE.h5 in one or more of the forms --compact, --csv, ...

    Strings with a result and their used and fresh samples are exported, also while a run is
    writing; --unused adds the rest. --compact copies everything. No existing file is overwritten. A
    sample without stored frames is simulated again, with identical results.
    """
    paths = [path for path in (compact, csv, xarray, arviz, as_json, paraview) if path is not None]
    if not paths:
        *forms, last = FORMS
        raise click.UsageError(f"nothing to write: give {', '.join(forms)} or {last}")
    if len({path.resolve() for path in paths}) < len(paths):
        raise click.UsageError("two options name the same file; give two names")
    if paraview is None and (string is not None or samples or frames is not None):
        raise click.UsageError("--string, --sample and --frames are for --paraview OUT.vtkhdf")
    if unused and paths in ([compact], [paraview], [compact, paraview]):
        raise click.UsageError("--unused is for --csv, --xarray, --arviz and --json")
    numbers = tolerance, measured, error
    wanted = arviz is not None or as_json is not None
    request = read_set_request("--arviz OUT.nc or --json OUT.json", wanted, *numbers)
    from agglom_mpi.analysis.damage import blame_damage
    from agglom_mpi.report.export import Exports, export

    selection = None
    if paraview is not None:
        from agglom_mpi.report.paraview import FrameSelection

        selection = FrameSelection(paraview, string, samples, frames)
    exports = Exports(compact, csv, xarray, arviz, request, selection, as_json)
    with blame_damage(file):
        for line in export(Path(file), exports, allow_code, unused):
            say(line)
    return 0
