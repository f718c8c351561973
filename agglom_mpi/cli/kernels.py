"""`agglom kernels`: rates of collision, sticking and breakage by mass, for population balances."""

import math
from typing import Any

import click

from agglom_mpi.cli.common import (
    ALLOW_CODE,
    JSON,
    PATH,
    SETTINGS,
    examples,
    exit_with,
    require_own_names,
    say,
)


@click.command(
    epilog=examples(
        "agglom kernels jobs/accretion_2003.yaml --samples 400 --csv kernels.csv",
        "agglom kernels accretion_2003.h5 --string 107 --time 0.05 --netcdf kernels.nc",
        "agglom kernels jobs/questions/barrier.yaml --impose 0.02 0.5 1",
    )
)
@click.argument("source", type=PATH)
@SETTINGS
@click.option("--string", type=click.IntRange(0), help="String of FILE.h5.")
@click.option(
    "--samples",
    default=200,
    show_default=True,
    type=click.IntRange(3, 10**6),
    help="Number of samples to simulate.",
)
@click.option(
    "--bins",
    default=12,
    show_default=True,
    type=click.IntRange(1, 100),
    help="Bins a decade of mass.",
)
@click.option(
    "--time",
    "times",
    multiple=True,
    type=float,
    metavar="S",
    help="Time in s at which a window ends and the next begins; may be repeated.",
)
@click.option(
    "--error",
    default=0.2,
    show_default=True,
    type=click.FloatRange(0.0, 1.0, min_open=True),
    help="Merge pairs of bins until the relative standard error of their efficiency is smaller.",
)
@click.option(
    "--impose",
    type=(click.FloatRange(1e-12, 1e6), click.FloatRange(-4.0, 4.0), click.FloatRange(1e-30, 1e30)),
    metavar="V P S",
    help="Grow for S s at relative speeds, root mean square V ((r1 + r2)/2b0)^P in m/s.",
)
@click.option("--csv", type=PATH, metavar="FILE", help="Write all pairs as CSV, with units.")
@click.option("--netcdf", type=PATH, metavar="FILE", help="Write all arrays as NetCDF.")
@ALLOW_CODE
@JSON
@exit_with
def kernels(as_json: bool, **options: Any) -> int:
    """Count collisions by mass in samples of a string of CAMPAIGN.yaml, or of FILE.h5.

    Shown for each pair of bins of mass: the rate coefficient; the collision efficiency, which is
    that over the rate of Maxwellian grains of the same partial temperatures; the shares that stick
    and break; mean normal speed and loss of energy. Each has its standard error, by a jackknife
    over samples; pairs with few collisions are merged with neighbours. Pieces of broken particles
    are shown by mass. Population balances take these as kernels.

    --impose solves the Smoluchowski equations where something else than the grains' own motion
    decides their relative speeds, also beyond the masses of the samples.
    """
    for option, given in (("--impose", options["impose"] or ()), ("--error", [options["error"]])):
        if any(map(math.isnan, given)):
            raise click.UsageError(f"{option}: is nan; must be a number")
    require_own_names({"--csv": options["csv"], "--netcdf": options["netcdf"]})
    from agglom_mpi.display.run_display import print_wide
    from agglom_mpi.report.growth_table import growth_text
    from agglom_mpi.report.kernel_table import (
        KernelRequest,
        kernel_json,
        kernel_text,
        string_growth,
        string_kernels,
    )

    request = KernelRequest(**options)
    found = string_kernels(request, show=lambda line: say(line, error=True))
    if not as_json:
        print_wide(kernel_text(found))
    growth = string_growth(request, found)
    if as_json:
        say(kernel_json(found, growth))
    elif growth is not None:
        print_wide(growth_text(growth, found.grain_mass))
    return 0
