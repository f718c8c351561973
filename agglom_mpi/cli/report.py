"""`agglom report`: results of campaign files."""

from pathlib import Path
from typing import Any

import click

from agglom_mpi.cli.common import JSON, PATH, examples, exit_with
from agglom_mpi.errors import INTERRUPTED


@click.command(
    epilog=examples(
        "agglom report accretion_2003.h5",
        "agglom report accretion_2003.h5 --out report",
        "agglom report seed1.h5 seed2.h5",
    )
)
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option(
    "--out",
    type=PATH,
    metavar="DIR",
    help="Write a web page, report.html, with figures as PNG and SVG instead.",
)
@click.option(
    "--stored-only",
    is_flag=True,
    help="With --out: do not resimulate samples whose particles are not stored.",
)
@click.option(
    "--sensitivity",
    is_flag=True,
    help="Add Sobol indices of the variables, by a regression; takes seconds.",
)
@JSON
@click.option("--follow", is_flag=True, help="First show the progress of its run, until it ends.")
@exit_with
def report(
    files: tuple[str, ...],
    out: Path | None,
    stored_only: bool,
    sensitivity: bool,
    as_json: bool,
    follow: bool,
) -> int:
    """Print the best strings of a campaign FILE.h5, also while it is being written.

    Strings are ranked by their re-estimates on fresh samples, where there are any. Several files
    are compared by their best strings. The web page is a single file; in DIR, only files with the
    names of the page and its figures are replaced. With --follow the exit code is that of the run,
    or 130 after Ctrl-C, which does not affect the run.
    """
    options = {"--sensitivity": sensitivity, "--out": out is not None, "--follow": follow}
    for option, given in options.items():
        if len(files) > 1 and given:
            raise click.UsageError(f"{option} takes one file")
    if out is None and stored_only:
        raise click.UsageError("--stored-only is for --out DIR")
    if out is not None and as_json:
        raise click.UsageError("give --out or --json, not both")
    code = _follow(files[0]) if follow else 0
    if code == INTERRUPTED:
        return code
    if out is not None:
        _write_page(files[0], out, not stored_only, sensitivity)
        return code
    from agglom_mpi.display.display import print_wide

    several = len(files) > 1
    text = _comparison(files, as_json) if several else _summary(files[0], sensitivity, as_json)
    click.echo(text) if as_json else print_wide(text)
    return code


def _follow(file: str) -> int:
    """Show the progress of a run until it ends; return its exit code, or `INTERRUPTED`."""
    from agglom_mpi.report.follow import follow
    from agglom_mpi.storage.reader import read_inversion

    return follow(read_inversion(file))


def _write_page(file: str, out: Path, resimulate: bool, sensitivity: bool) -> None:
    """Write the web page of a file, and print its path."""
    from agglom_mpi.report.page import write_report
    from agglom_mpi.storage.reader import read_inversion

    for line in write_report(read_inversion(file), out, resimulate, sensitivity):
        click.echo(line)


def _summary(file: str, sensitivity: bool, as_json: bool) -> Any:
    """Return the summary of one file as a renderable, or as JSON."""
    from agglom_mpi.analysis.summary import collect_summary, summary_table, to_json
    from agglom_mpi.storage.reader import read_inversion

    opened, indices = read_inversion(file), None
    if sensitivity:
        from agglom_mpi.analysis import sensitivity as sensitivities

        indices = sensitivities.sensitivity_of(opened)
    if as_json:
        extra = {} if indices is None else {"sensitivity": sensitivities.as_dict(*indices)}
        return to_json(collect_summary(opened), extra)
    from rich.console import Group

    more = [] if indices is None else [sensitivities.sensitivity_table(*indices)]
    return Group(summary_table(opened), *more)


def _comparison(files: tuple[str, ...], as_json: bool) -> Any:
    """Return the comparison of several files as a renderable, or as JSON."""
    from agglom_mpi.analysis import file_comparison as comparison
    from agglom_mpi.storage.reader import read_inversion

    compared = comparison.compare([read_inversion(file) for file in files])
    return comparison.to_json(compared) if as_json else comparison.comparison_table(compared)
