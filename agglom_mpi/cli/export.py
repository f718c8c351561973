"""`agglom export`: a campaign file as a compact copy, CSV, netCDF, JSON and in other forms."""

from pathlib import Path
from typing import Any, Final

import click

from agglom_mpi.cli.common import (
    ALLOW_CODE,
    PATH,
    UNUSED,
    DependentOption,
    examples,
    exit_with,
    require_own_names,
    say,
)
from agglom_mpi.cli.set_options import read_set_request, set_options

FORMS: Final = (
    *("--compact", "--csv", "--xarray", "--arviz", "--json", "--emulator", "--paraview"),
)
"""Options that write something."""


@click.command(
    epilog=examples(
        "agglom export accretion_2003.h5 --compact accretion_2003_compact.h5",
        "agglom export accretion_2003.h5 --csv tables",
        "agglom export accretion_2003.h5 --paraview best.vtkhdf",
        "agglom export accretion_2003.h5 --arviz draws.nc --measured 2 --error 2%",
        "agglom export accretion_2003.h5 --emulator growth.npz",
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
    type=PATH,
    metavar="OUT.json",
    help="Write the posterior of all data with its calibration; without data, the feasible set.",
)
@set_options("--arviz or --json", " or --emulator")
@click.option(
    "--emulator",
    type=PATH,
    metavar="OUT.npz",
    help="Write the emulated growth and measured data of any string of the box, and OUT.py, which "
    "evaluates the file with NumPy alone.",
)
@click.option(
    "--paraview",
    type=PATH,
    metavar="OUT.vtkhdf",
    help="Write the particles of a sample over time for ParaView. Several samples get one file "
    "each, OUT_STRING_SAMPLE.vtkhdf.",
)
@click.option(
    "--string",
    cls=DependentOption,
    needs="--paraview",
    type=click.IntRange(0),
    help="string to write.  [default: the best]",
)
@click.option(
    "--sample",
    "samples",
    cls=DependentOption,
    needs="--paraview",
    type=click.IntRange(0),
    multiple=True,
    help="sample to write; may be repeated.  [default: all with stored frames, or the first]",
)
@click.option(
    "--frames",
    cls=DependentOption,
    needs="--paraview",
    type=click.IntRange(1, 10**5),
    help="resimulate the sample with this number of frames.  [default: those stored, or 101]",
)
@UNUSED
@ALLOW_CODE
@exit_with
def export(file: str, allow_code: bool, unused: bool, **options: Any) -> int:
    """Export a campaign FILE.h5 in one or more of the forms --compact, --csv, ...

    Strings with a result and their used and fresh samples are exported, also while a run is
    writing; --unused adds the rest. --compact copies everything. No existing file is overwritten. A
    sample without stored frames is simulated again, with identical results.
    """
    forms = {form: options[form.removeprefix("--")] for form in FORMS}
    given = {form for form, path in forms.items() if path is not None}
    if not given:
        raise click.UsageError(f"nothing to write: give {', '.join(FORMS)}")
    emulator: Path | None = options["emulator"]
    is_named = emulator is not None and emulator.suffix == ".npz"
    module = emulator.with_suffix(".py") if emulator is not None and is_named else None
    require_own_names(forms | {"the module of --emulator": module})
    if unused and given <= {"--compact", "--paraview"}:
        raise click.UsageError("--unused is for --csv, --xarray, --arviz, --json and --emulator")
    request = read_set_request(options) if given & {"--arviz", "--json"} else None
    from agglom_mpi.analysis.damage import blame_damage
    from agglom_mpi.report.export import Exports, export

    selection = portable = None
    if options["paraview"] is not None:
        from agglom_mpi.report.paraview import FrameSelection

        chosen = (options[name] for name in ("paraview", "string", "samples", "frames"))
        selection = FrameSelection(*chosen)
    if emulator is not None:
        from agglom_mpi.inference.emulator_file import EmulatorRequest

        portable = EmulatorRequest(emulator, options["tolerance"])
    exports = Exports(
        options["compact"],
        options["csv"],
        options["xarray"],
        options["arviz"],
        request,
        selection,
        options["json"],
        portable,
    )
    with blame_damage(file):
        for line in export(Path(file), exports, allow_code, unused):
            say(line)
    return 0
