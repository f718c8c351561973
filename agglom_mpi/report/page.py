"""The web page `report.html` with its figures, which `agglom report --out DIR` writes."""

import io
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from rich.console import Console, Group, RenderableType

from agglom_mpi.analysis.comparison import PairedSamples
from agglom_mpi.analysis.data_fit import describe_fit
from agglom_mpi.analysis.estimates import rounding_of
from agglom_mpi.analysis.failed_samples import no_result
from agglom_mpi.analysis.finite_size import describe_finite_size
from agglom_mpi.analysis.ranking import listed_strings, rank_strings
from agglom_mpi.analysis.selection_bias import describe_bias, selection_bias
from agglom_mpi.analysis.summary import moment_notes
from agglom_mpi.config.describe import sections
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.errors import require_library
from agglom_mpi.formatting import pluralise, printable
from agglom_mpi.inference.data_posterior import data_posterior
from agglom_mpi.inference.feasible_set import FeasibleSet
from agglom_mpi.inference.next_measurement import NextMeasurements
from agglom_mpi.inference.posterior import Posterior
from agglom_mpi.outcome import COMPLETED, FAILED
from agglom_mpi.report import page_tables
from agglom_mpi.report.drawing import Drawing, write_drawing
from agglom_mpi.report.embedding import EmbeddedFigure, embedded
from agglom_mpi.report.export import require_directory
from agglom_mpi.report.figures import FIGURES
from agglom_mpi.report.figures.figure import FigureOptions
from agglom_mpi.report.figures.next_measurement import next_drawing
from agglom_mpi.report.figures.posterior_figures import pairs_drawing, posterior_drawings
from agglom_mpi.report.figures.set_figures import set_drawings
from agglom_mpi.report.next_summary import PosteriorRequest, next_text
from agglom_mpi.report.posterior_summary import data_posterior_text
from agglom_mpi.report.published_results import Published, comparison_tables
from agglom_mpi.report.sample_particles import (
    RESIMULATION_SECONDS,
    FramesUnavailableError,
    all_stored,
)
from agglom_mpi.report.set_files import SetRequest, write_files
from agglom_mpi.report.set_summary import set_text
from agglom_mpi.storage.files import replace_file
from agglom_mpi.storage.lock import live_status
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_campaign, require_code
from agglom_mpi.storage.schema import FAILURE_CAPACITY

NAME: Final = "report.html"
TEMPLATE: Final = "report.html.j2"
PROVENANCE: Final = ("seed", "created", "code_version", "campaign_sha256", "sources_sha256")
"""Attributes of the file that the page names."""

TEXT_WIDTH: Final = 140
"""Number of characters in a line of text on the page."""
NARROW_TEXT_WIDTH: Final = 42
"""Number of characters in a line of text on the page of a narrow screen."""
QUESTION: Final = ("objective", "target", "final answer")
"""Lines on a run that stand at the top of the page."""

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
    found = None if posterior is None else file.derived(data_posterior)
    directory.mkdir(parents=True, exist_ok=True)
    options = FigureOptions(seconds=RESIMULATION_SECONDS if simulate else 0.0)
    page = PageBuilder(file, directory, options, sensitivity, published)
    if feasible_set is not None:
        page.draw_set(feasible_set)
    if found is not None and posterior is not None:
        page.add_posterior(found, posterior.found(found))
    for section in dict.fromkeys(figure.section for figure in FIGURES.values()):
        resimulates = section == "particles" and simulate and not all_stored(file)
        if resimulates and rank_strings(file).order:
            yield RESIMULATION_MESSAGE
        page.draw(section)
    replace_file(directory / NAME, page.render().encode())
    seconds = time.perf_counter() - begun
    drawn = pluralise(page.figure_count, "figure")
    yield f"{directory / NAME}: {drawn} as PNG and SVG, {seconds:.1f} s"


class PageBuilder:
    """Writes the figures of a campaign into a directory, and makes its page of them.

    Attributes
    ----------
    figure_count
        Figures written so far.
    """

    def __init__(
        self,
        data: CampaignData,
        directory: Path,
        options: FigureOptions,
        sensitivity: bool,
        published: Published | None = None,
    ) -> None:
        self.figure_count = 0
        self._data = data
        self._directory = directory
        self._options = options
        self._sensitivity = sensitivity
        self._published = published
        self._figures: dict[str, list[EmbeddedFigure]] = {}
        self._frames_unavailable = ""
        self._set_texts: tuple[str, ...] = ()
        self._posterior_texts: tuple[str, ...] = ()

    def draw(self, section: str) -> None:
        """Write the figures of a section of the page that have something to show."""
        self._figures.setdefault(section, [])
        for figure in FIGURES.values():
            if figure.section != section or (figure.on_request and not self._sensitivity):
                continue
            try:
                drawing = figure.drawing(self._data, self._options)
            except FramesUnavailableError as error:
                self._frames_unavailable = str(error)
                continue
            if drawing is not None:
                self._write(section, drawing)

    @single_threaded
    def draw_set(self, request: SetRequest) -> None:
        """Write the figures of the feasible set, and keep its text for the page."""
        found = FeasibleSet(self._data, request.tolerance)
        posterior = request.posterior_of(found)
        write_files(request, found, posterior)
        widths = (TEXT_WIDTH, NARROW_TEXT_WIDTH)
        self._set_texts = tuple(plain_text(set_text(found, posterior), width) for width in widths)
        for drawing in set_drawings(self._data, found) if found.calibration.passed else ():
            self._write("set", drawing)
        if posterior is not None:
            self._write("set", pairs_drawing(self._data, posterior, "set_posterior"))

    @single_threaded
    def add_posterior(self, posterior: Posterior, further: NextMeasurements | None) -> None:
        """Write the figures of the posterior of all data and of what to measure next.

        Their texts are kept for the page.
        """
        widths = (TEXT_WIDTH, NARROW_TEXT_WIDTH)
        text: RenderableType = data_posterior_text(posterior)
        drawings = posterior_drawings(self._data, posterior)
        if further is not None:
            text = Group(text, "", next_text(further))
            drawings.append(next_drawing(further))
        self._posterior_texts = tuple(plain_text(text, width) for width in widths)
        for drawing in drawings:
            self._write("posterior", drawing)

    def _write(self, section: str, drawing: Drawing) -> None:
        """Write a figure into the directory, and keep it for a section of the page."""
        write_drawing(self._directory, drawing)
        self._figures.setdefault(section, []).append(embedded(self._directory, drawing))
        self.figure_count += 1

    def render(self) -> str:
        """Return the page with the figures drawn so far, as HTML."""
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
        environment.globals["pluralise"] = pluralise
        return environment.get_template(TEMPLATE).render(self._content())

    def _content(self) -> dict[str, Any]:
        """Return the variables of the template."""
        data, published = self._data, self._published
        completed = int((data.counted_samples["state"] == COMPLETED).sum())
        return {
            "title": data.title or data.path.stem,
            "file_name": data.path.name,
            "status": live_status(data),
            "generations": len(data.generation_rows()),
            "judged": len(data.result_rows()),
            "no_result": no_result(data),
            "samples_used": int(data.result_rows()["samples_used"].sum()),
            "simulated": len(data.all_sample_rows()),
            "figures": self._figures,
            "frames_unavailable": self._frames_unavailable,
            "sensitivity": self._sensitivity,
            "set_texts": self._set_texts,
            "posterior_texts": self._posterior_texts,
            "ranges": page_tables.ranges(data),
            "strings": page_tables.all_strings(data) if rank_strings(data).order else None,
            "best": page_tables.best_strings(data) if rank_strings(data).order else None,
            "comparison": comparison_lines(data),
            "estimated": bool(rank_strings(data).estimates),
            "published": published,
            "published_tables": [] if published is None else comparison_tables(data, published),
            "legs": page_tables.legs(data) if len(data.legs()) else None,
            "completed": completed,
            "ledger": page_tables.ledger(data) if completed else None,
            "damaged": data.damaged,
            "provenance": {
                name: data.attributes[name] for name in PROVENANCE if name in data.attributes
            },
            "campaign_text": data.campaign_text,
            **scene_content(data),
            **failure_content(data),
        }


def _safe(value: Any) -> Any:
    """Return what the template writes: texts without what would turn or hide others."""
    return type(value)(printable(value)) if isinstance(value, str) else value


def plain_text(content: RenderableType, width: int) -> str:
    """Return a renderable as lines of text with at most `width` characters."""
    console = Console(width=width, color_system=None, file=io.StringIO())
    with console.capture() as captured:
        console.print(content, soft_wrap=False)
    return typeset("\n".join(line.rstrip() for line in captured.get().splitlines()))


def typeset(text: str) -> str:
    """Return a text of the terminal with the radius of the start as figures and tables show it."""
    return text.replace("b/b0", "b/b⁰")


def comparison_lines(data: CampaignData) -> list[str]:
    """Return sentences on the order of the best strings and its significance."""
    if not rank_strings(data).order:
        return []
    shown = rank_strings(data).order[: listed_strings(data)]
    estimated = {estimate.string for estimate in rank_strings(data).estimates}.intersection(shown)
    paired = PairedSamples.behind(rank_strings(data).estimates, data)
    bias = selection_bias(rank_strings(data).estimates, paired, rounding_of(data))
    verdict = describe_bias(bias, shown, len(estimated))
    fit = describe_fit(data, shown[0]) if shown else []
    size = describe_finite_size(data, shown)
    lines = [*verdict, *moment_notes(data), *fit, *size, *data.unused_notes]
    return [typeset(line) for line in lines]


def scene_content(data: CampaignData) -> dict[str, Any]:
    """Return the template's variables on the scene: its submodels, and what it leaves out."""
    try:
        first, *rest = sections(recorded_campaign(data))
    except CampaignError as error:
        return {"unreadable": str(error), "question": []}
    pairs = [line.partition(": ") for line in first[1]]
    headings = dict(rest)
    left_out, submodels = headings.pop("Left out"), headings.pop("Submodels")
    return {
        "unreadable": "",
        "question": [(name, text) for name, _, text in pairs if name in QUESTION],
        "left_out": left_out,
        "submodels": submodels,
        "campaign_sections": [first, *headings.items()],
    }


def failure_content(data: CampaignData) -> dict[str, Any]:
    """Return the template's variables on the samples that failed."""
    failed = data.all_sample_rows()[data.all_sample_rows()["state"] == FAILED]
    late = data.timed_out
    return {
        "failed": page_tables.failed_samples(data, failed),
        "timed_out": len(late),
        "failure_texts": len(data.failures()),
        "failure_texts_full": len(data.failures()) == FAILURE_CAPACITY,
    }
