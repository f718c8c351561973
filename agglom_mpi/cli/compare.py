"""`agglom compare`: which of several laws explains the same data."""

import json

import click

from agglom_mpi.cli.common import ALLOW_CODE, JSON, examples, exit_with, say


@click.command(
    epilog=examples("agglom compare dry.h5 wet.h5", "agglom compare dry.h5 wet.h5 --json"),
)
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@ALLOW_CODE
@JSON
@exit_with
def compare(files: tuple[str, ...], allow_code: bool, as_json: bool) -> int:
    """Compare how campaigns with the same data and different laws explain these.

    Each FILE.h5 has the objective misfit. Shown are the probability of each at equal odds, by the
    evidence of the data; the p-value of its fit; what a search box of twice the size would change,
    as boxes are priors; and the log density of the data, each left out in turn, with the datum and
    the experiment that decide. The verdict may be that none explains the data, or that they do not
    decide: then further measurements are ranked by the expected probability of the right law after
    them, which takes some minutes.
    """
    if len(files) < 2:
        raise click.UsageError("give at least two files")
    from agglom_mpi.analysis.damage import blame_damage
    from agglom_mpi.display.run_display import print_wide
    from agglom_mpi.inference.law_comparison import compare_files
    from agglom_mpi.report.posterior_summary import law_text
    from agglom_mpi.storage.reader import read_inversion

    opened = [read_inversion(file, allow_code) for file in files]
    with blame_damage(*files):
        found = compare_files(opened)
    if as_json:
        say(json.dumps(found.as_dict(), indent=2))
    else:
        print_wide(law_text(found))
    return 0
