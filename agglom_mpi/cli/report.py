"""`agglom report`: results of campaign files."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from agglom_mpi.cli.common import (
    ALLOW_CODE,
    JSON,
    PATH,
    UNUSED,
    DependentOption,
    examples,
    exit_with,
    require_own_names,
    say,
)
from agglom_mpi.cli.set_options import read_set_request, set_options
from agglom_mpi.errors import FAILURE, FINISHED, INTERRUPTED
from agglom_mpi.formatting import without_nan

if TYPE_CHECKING:
    from agglom_mpi.report.set_files import PosteriorRequest, SetRequest
    from agglom_mpi.storage.reader import CampaignData


@click.command(
    epilog=examples(
        "agglom report accretion_2003.h5",
        "agglom report accretion_2003.h5 --out report",
        "agglom report accretion_2003.h5 --feasible-set --tolerance 5%",
        "agglom report measured.h5 --posterior",
        "agglom report seed1.h5 seed2.h5",
    )
)
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option(
    "--out",
    type=PATH,
    metavar="DIR",
    help="Write a web page, report.html, and its figures as PNG and SVG, instead of the table.",
)
@click.option(
    "--stored-only",
    cls=DependentOption,
    needs="--out",
    is_flag=True,
    help="do not simulate samples again whose particles are not stored.",
)
@click.option(
    "--published",
    cls=DependentOption,
    needs="--out",
    type=PATH,
    metavar="TABLES.json",
    help="set the best strings beside a paper's tables, such as jobs/published/*.json.",
)
@click.option(
    "--sensitivity",
    is_flag=True,
    help="Add the Sobol index of each variable, from a regression of all strings.",
)
@click.option(
    "--posterior",
    is_flag=True,
    help="Add the posterior of the variables, given all measured data; takes some ten seconds.",
)
@click.option(
    "--what-next",
    cls=DependentOption,
    needs="--posterior",
    is_flag=True,
    help="add what each further measurement would leave of the box, the most "
    "informative one first; takes a minute.",
)
@click.option(
    "--what-next-table",
    cls=DependentOption,
    needs="--what-next",
    type=PATH,
    metavar="OUT.csv",
    help="write all measurements that could be made.",
)
@click.option(
    "--feasible-set",
    is_flag=True,
    help="Print which parameters are compatible with the target, with probabilities.",
)
@set_options("--feasible-set")
@click.option(
    "--draws",
    cls=DependentOption,
    needs="--measured",
    type=PATH,
    metavar="OUT.csv",
    help="write strings drawn from the posterior, with weights.",
)
@click.option(
    "--grid",
    cls=DependentOption,
    needs="--feasible-set",
    type=PATH,
    metavar="OUT.csv",
    help="write the probability on a grid of points.",
)
@UNUSED
@ALLOW_CODE
@JSON
@click.option("--follow", is_flag=True, help="First display the progress of the run until it ends.")
@exit_with
def report(files: tuple[str, ...], as_json: bool, allow_code: bool, **options: Any) -> int:
    """Print the best strings of a campaign FILE.h5; the run may still be writing.

    Strings are ranked by their re-estimates on fresh samples, which no decision has used. Without
    fresh samples they are ranked as searched. Several files are compared by their best strings;
    of one question with other seeds, a set and a posterior rest on the samples of all, and the page
    has the rest of the first.
    With --out, only files with the names of the page and its figures are replaced in DIR.

    Exit codes: 0 success; 1 if the file is altered or lacks rows.
    With --follow: that of the run, or 130 after Ctrl-C, which does not stop the run.
    """
    _check_options(len(files), as_json, options)
    out, request = options["out"], None
    if options["feasible_set"]:
        request = read_set_request(options, "draws", "grid")
    asked = None
    if options["posterior"]:
        from agglom_mpi.report.set_files import PosteriorRequest

        asked = PosteriorRequest(options["what_next"], options["what_next_table"])
    from agglom_mpi.storage.reader import read_inversion
    from agglom_mpi.storage.recorded_campaign import code_note

    code = _follow(files[0], allow_code) if options["follow"] else FINISHED
    if code == INTERRUPTED:
        return code
    opened = [read_inversion(file, allow_code) for file in files]
    for file in opened:
        file.with_unused = options["unused"]
        file.settle()
    from agglom_mpi.analysis.damage import blame_damage

    if len(opened) > 1 and (asked or request or out is not None):
        from agglom_mpi.analysis.file_comparison import pooled

        pooled(opened)
    with blame_damage(*files):
        if out is not None:
            from agglom_mpi.report.page import write_report
            from agglom_mpi.report.sections.published import read_published

            tables = options["published"] and read_published(options["published"])
            more = not options["stored_only"], options["sensitivity"], request, asked, tables
            for line in write_report(opened[0], out, *more):
                say(line)
        elif (
            code_note(opened[0])
            and len(files) == 1
            and not any((request, asked, options["sensitivity"]))
        ):
            from agglom_mpi.analysis.summary import stored_text

            say(stored_text(opened[0], as_json))
        else:
            from agglom_mpi.analysis.run_warnings import run_warnings

            text = _text(opened, request, asked, options["sensitivity"], as_json)
            if as_json:
                say(text)
            else:
                from agglom_mpi.display.run_display import print_wide

                print_wide(text)
            if len(files) == 1 and request is None:  # as at the end of the run
                for line in run_warnings(opened[0]):
                    say(f"warning: {line}", error=True)
    for file in opened:
        for line in file.unused_notes:
            say(line, error=True)
    return max(code, *map(_mention_damage, opened))


def _check_options(files: int, as_json: bool, options: Mapping[str, Any]) -> None:
    """Raise a UsageError if options exclude each other, or files to write have one name."""
    if files > 1 and options["what_next"]:
        raise click.UsageError(
            "--what-next takes one file; agglom compare ranks measurements by how well they tell "
            "the laws of several files apart"
        )
    for name in ("sensitivity", "follow"):
        if files > 1 and options[name]:
            raise click.UsageError(f"--{name} takes one file")
    out = options["out"]
    if options["posterior"] and options["feasible_set"] and out is None:
        raise click.UsageError("give --posterior or --feasible-set, or both with --out DIR")
    if out is not None and as_json:
        raise click.UsageError("give --out or --json, not both")
    names = "draws", "grid", "what_next_table"
    require_own_names({f"--{name.replace('_', '-')}": options[name] for name in names}, page=out)


def _mention_damage(file: "CampaignData") -> int:
    """Say on standard error if rows are left out or absent; return the exit code.

    What is altered was said when it was read.
    """
    from agglom_mpi.analysis.completeness import damage_lines

    lines = damage_lines(file)
    for line in lines:
        say(line, error=True)
    return FAILURE if lines or file.altered else FINISHED


def _follow(name: str, allow_code: bool) -> int:
    """Show the progress of a run until it ends; return its exit code, or `INTERRUPTED`."""
    from agglom_mpi.report.follow import follow, wait_for_file
    from agglom_mpi.storage.reader import read_inversion

    path = Path(name)
    if path.parent.is_dir() and not wait_for_file(path):
        return INTERRUPTED
    return follow(read_inversion(name, allow_code))


def _text(
    opened: list["CampaignData"],
    request: "SetRequest | None",
    posterior: "PosteriorRequest | None",
    sensitivity: bool,
    as_json: bool,
) -> Any:
    """Return what is asked of files as a renderable, or as JSON; write the files of a request."""
    from rich.console import Group

    compared = None
    if len(opened) > 1:
        from agglom_mpi.analysis import file_comparison as comparison

        compared = comparison.compare(opened)
        table = comparison.comparison_table(compared)
        if request is None and posterior is None:
            return comparison.to_json(compared) if as_json else table
    file = opened[0]
    entries: dict[str, Any] = {}
    more: list[Any] = []
    if sensitivity:
        from agglom_mpi.analysis import sensitivity as sobol

        indices = sobol.sensitivity_of(file)
        entries["sensitivity"] = sobol.as_dict(*indices)
        more.append(sobol.sensitivity_table(*indices))
    if request is not None:
        from agglom_mpi.report.set_files import set_report

        found = set_report(file, request, as_json, **entries)
        return found if as_json else Group(*([table, ""] if compared else []), found, *more)
    if posterior is not None:
        from agglom_mpi.inference.data_posterior import data_posterior
        from agglom_mpi.report.posterior_summary import next_text, posterior_text

        posterior.check()
        given = file.derived(data_posterior)
        further = posterior.found(given)
        entries["posterior"] = given.as_dict()
        more += ["", posterior_text(given)]
        if further is not None:
            entries["posterior"] |= {"next_measurements": without_nan(further.records())}
            more += ["", next_text(further, file.campaign_text)]
    if compared is not None:
        return comparison.to_json(compared, entries) if as_json else Group(table, *more)
    from agglom_mpi.analysis.summary import collect_summary, summary_table, to_json

    return to_json(collect_summary(file), entries) if as_json else Group(summary_table(file), *more)
