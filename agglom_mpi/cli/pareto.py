"""`agglom pareto`: two numbers of the best strings of several campaign files."""

import click

from agglom_mpi.cli.common import ALLOW_CODE, examples, exit_with, say


@click.command(
    epilog=examples("agglom pareto power_*.h5 --x power --y objective"),
)
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option(
    "--x",
    required=True,
    metavar="NAME",
    help="Number that strings are compared by: objective, mean_radius_ratio, a variable, a derived "
    "quantity, or one of samples: of the objective's function, or of grains that spin.",
)
@click.option(
    "--y",
    default="objective",
    show_default=True,
    metavar="NAME",
    help="Second number.",
)
@click.option(
    "--maximise",
    multiple=True,
    metavar="NAME",
    help="Number that is better the higher it is; may be repeated.  [default: lower is better]",
)
@ALLOW_CODE
@exit_with
def pareto(
    files: tuple[str, ...],
    x: str,
    y: str,
    maximise: tuple[str, ...],
    allow_code: bool,
) -> int:
    """Show the Pareto front of the best strings of several campaign files FILE.h5.

    The campaigns ask one question under different constraints, such as power < 10 W. The best
    string of each file has its re-estimate on fresh samples, with standard errors. A string is
    dominated if another is better by at least two standard errors on both axes, or as good on an
    axis without errors, such as a variable. Errors are not of the search, which may have missed
    better strings.
    """
    if x == y:
        raise click.UsageError("--x and --y name the same number; give two")
    for name in maximise:
        if name not in (x, y):
            raise click.UsageError(f"--maximise {name}: is neither that of --x nor of --y")
    from agglom_mpi.analysis.damage import blame_damage
    from agglom_mpi.analysis.file_comparison import is_one_question
    from agglom_mpi.analysis.trade_off import OBJECTIVE, axis_of, trade_off
    from agglom_mpi.display.run_display import print_wide
    from agglom_mpi.storage.reader import read_inversion

    opened = [read_inversion(file, allow_code) for file in files]
    with blame_damage(*files):
        axes = axis_of(opened, x, x in maximise), axis_of(opened, y, y in maximise)
        print_wide(trade_off(opened, axes))
    if OBJECTIVE in (x, y) and not is_one_question(opened):
        say("warning: the objectives are not of the same question", error=True)
    return 0
