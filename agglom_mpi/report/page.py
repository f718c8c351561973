"""The web page `report.html` with its figures, which `agglom report --out DIR` writes."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.display.table import Table
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.errors import require_library
from agglom_mpi.formatting import pluralise, printable
from agglom_mpi.inference.data_posterior import data_posterior
from agglom_mpi.report.export import require_directory
from agglom_mpi.report.figures.figure import FigureOptions
from agglom_mpi.report.sample_particles import RESIMULATION_SECONDS, all_stored
from agglom_mpi.report.sections.published import Published
from agglom_mpi.report.sections.section import Page
from agglom_mpi.report.set_files import PosteriorRequest, SetRequest
from agglom_mpi.storage.files import replace_file
from agglom_mpi.storage.lock import live_status
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import require_code

NAME: Final = "report.html"
TEMPLATE: Final = "report.html.j2"

PRINTED_CHARACTERS: Final = 105
"""Maximum number of characters of a table beside each other on paper, which is as wide as A4."""

RESIMULATION_MESSAGE: Final = (
    "simulating the best string again for pictures of its particles, which are not stored; the "
    "first time on a machine, its kind of scene is compiled"
)


def write_report(
    file: CampaignData,
    directory: Path,
    simulate: bool = True,
    sensitivity: bool = False,
    feasible_set: SetRequest | None = None,
    posterior: PosteriorRequest | None = None,
    published: Published | None = None,
) -> Iterator[str]:
    """Write the page and its figures into a directory, and yield lines on progress.

    The directory is made. Each file is complete under its name or as it was before; the page is
    written last.

    Parameters
    ----------
    file
        Of a campaign, finished or not.
    directory
    simulate
        Whether particles that are not stored may be resimulated.
    sensitivity
        Whether to show the sensitivities of the objective, which take seconds.
    feasible_set
        What to show of the feasible set, which takes seconds; None: nothing.
    posterior
        What to show of the posterior of all data, which takes some ten seconds; None: nothing.
    published
        Tables of a paper to show the best strings in; None: none.

    Raises
    ------
    ExportError, MissingLibraryError
        If the directory's name is that of something else, or a library is missing.
    OSError
        If it cannot be written.
    """
    begun = time.perf_counter()
    require_code(file)
    require_library("matplotlib", "report", "figures")
    require_library("jinja2", "report", "web pages")
    require_directory(directory)
    if feasible_set is not None:
        feasible_set.check(file, made=directory)
    if posterior is not None:
        posterior.check(made=directory)
    options = _computed(file, directory, feasible_set, posterior)._replace(
        seconds=RESIMULATION_SECONDS if simulate else 0.0, sensitivity=sensitivity
    )
    directory.mkdir(parents=True, exist_ok=True)
    if simulate and not all_stored(file) and rank_strings(file).order:
        yield RESIMULATION_MESSAGE
    page = Page(file, directory, options, published)
    replace_file(directory / NAME, render(page).encode())
    seconds = time.perf_counter() - begun
    drawn = pluralise(page.figure_count, "figure")
    yield f"{directory / NAME}: {drawn} as PNG and SVG, {seconds:.1f} s"


@single_threaded
def _computed(
    file: CampaignData,
    directory: Path,
    feasible_set: SetRequest | None,
    posterior: PosteriorRequest | None,
) -> FigureOptions:
    """Return the feasible set and posteriors that are asked for, and write their tables."""
    options = FigureOptions()
    if posterior is not None:
        found = file.derived(data_posterior)
        directory.mkdir(parents=True, exist_ok=True)
        options = options._replace(posterior=found, further=posterior.found(found))
    if feasible_set is not None:
        found_set, mean = feasible_set.found(file, directory)
        options = options._replace(feasible_set=found_set, mean_posterior=mean)
    return options


@single_threaded
def render(page: Page) -> str:
    """Return a page as HTML, and write its figures."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_safe,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.globals["csv"] = _csv
    environment.filters["typeset"] = _typeset
    environment.tests["broad"] = is_broad
    data = page.data
    judged, rows = data.result_rows(), data.all_sample_rows()
    summary = (
        f"{pluralise(len(data.generation_rows()), 'generation')}, "
        f"{pluralise(len(judged), 'string')} judged by "
        f"{pluralise(int(judged['samples_used'].sum()), 'sample')} of {len(rows)} simulated."
    )
    if data.pooled:
        names = ", ".join(each.path.name for each in data.pooled)
        summary += f" Sets and posteriors rest on the samples of {names}, too."
    return environment.get_template(TEMPLATE).render(
        title=data.title or data.path.stem,
        file_name=data.path.name,
        status=live_status(data),
        summary=summary,
        sections=list(page.sections()),
    )


def _safe(value: Any) -> Any:
    """Return what the template writes, printable: nothing in it turns or hides other texts."""
    return type(value)(printable(value)) if isinstance(value, str) else value


def _typeset(text: str) -> str:
    """Return a text of the report with the radius of the start as figures show it."""
    return text.replace("b/b0", "b/b⁰")


def is_broad(table: Table) -> bool:
    """Return whether a table has no room on paper even where texts break between all words.

    Numbers break before their errors alone. It is printed with a card for each row instead.
    """
    ends = [None if not place or each.text else " ±" for place, each in enumerate(table.shown)]
    words = [[heading.split() for heading in table.headings]]
    words += [[*map(str.split, row, ends)] for row in table.cells]
    columns = words if table.upright else zip(*words, strict=True)
    longest = (max(len(word) for cell in column for word in (*cell, "")) for column in columns)
    return sum(length + 2 for length in longest) > PRINTED_CHARACTERS


def _csv(table: Table) -> str:
    """Return a table as a `data:` URI of a CSV file, which needs no server and no script."""
    return f"data:text/csv;charset=utf-8,{quote(_typeset(table.csv()))}"
