"""What `agglom report --out DIR` writes: one web page that needs nothing else, and its figures."""

import time
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any, Final

from agglom_mpi.analysis import sensitivity as sensitivities
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.errors import require_library
from agglom_mpi.report import page_answer, page_run, sample_frames
from agglom_mpi.report.export import check_directory
from agglom_mpi.report.figures import (
    busy,
    convergence,
    cost,
    counts,
    ensembles,
    finalists,
    matters,
    parallel,
    paths,
    radii,
)
from agglom_mpi.report.figures.radii import target_ratio
from agglom_mpi.report.html import Section, figure, figures, page, paragraph
from agglom_mpi.report.picture import Picture, write_picture
from agglom_mpi.storage.files import replace_file
from agglom_mpi.storage.reader import CampaignData

NAME: Final = "report.html"

WAIT: Final = (
    "simulating the best string again for pictures of its particles, which are not stored; a kind "
    "of scene that was never looked at here is compiled first, once"
)
NO_CLOUD: Final = (
    "No cloud of particles: pictures are not stored, and to simulate a sample again takes too long "
    "or was not wanted. The campaign's output.frames stores some."
)


def write_report(
    file: CampaignData, directory: Path, simulate: bool = True, sensitivity: bool = False
) -> Iterator[str]:
    """Write the page and its figures into a directory, which is made; yield lines on progress.

    Every file is whole under its name or what it was before, and the page comes last.

    Parameters
    ----------
    simulate
        Whether particles that are not stored may be simulated again.
    sensitivity
        Whether to find out which variables matter, which takes seconds.

    Raises
    ------
    ExportError, MissingLibraryError
        If the directory's name is that of something else, or matplotlib is missing.
    OSError
        If it cannot be written.
    """
    begun = time.perf_counter()
    require_library("matplotlib", "report", "figures")
    check_directory(directory)
    directory.mkdir(parents=True, exist_ok=True)
    writer, sections = Writer(file, directory), []
    for part in writer.sections(simulate, sensitivity):
        if isinstance(part, str):
            yield part
        else:
            sections.append(part)
    title = str(file.attributes["title"]) or file.path.stem
    whole = page(title, page_answer.head(writer.data), sections)
    replace_file(directory / NAME, whole.encode())
    seconds = time.perf_counter() - begun
    yield f"{directory / NAME}: {writer.count} figures as PNG and SVG, {seconds:.1f} s"


class Writer:
    """Writes the figures of a campaign and makes the sections of its page."""

    def __init__(self, data: CampaignData, directory: Path) -> None:
        self.data = data
        self.count = 0
        self._directory = directory

    def sections(self, simulate: bool, sensitivity: bool) -> Iterator[Section | str]:
        """Yield the sections in order, and lines on what takes long."""
        data = self.data
        yield Section(
            "answer",
            "Best strings",
            page_answer.best_strings(data) + self.draw(finalists.pictures(data)),
        )
        search = self._several(convergence, paths, parallel, cost)
        if sensitivity:
            search += self._sensitivity()
        yield Section("search", "Search", search or paragraph("No generation is done yet."))
        if simulate and rank_strings(data).order and not sample_frames.all_stored(data):
            yield WAIT
        yield Section("particles", "Particles", self._particles(simulate))
        samples = self._several(ensembles, counts)
        yield Section("samples", "Samples", samples or paragraph("No string is judged yet."))
        yield Section("tables", *page_answer.tables_of_papers(data))
        yield Section("run", "Run", self._several(busy) + page_run.legs(data))
        yield Section("scene", "What the scene left out", page_run.left_out(data))
        yield Section("ledger", "Worst samples of the ledger", page_run.ledger(data))
        yield Section("failures", "Failures", page_run.failures(data))
        yield Section("origin", "Where this is from", page_run.provenance(data))

    def draw(self, pictures: Iterable[Picture]) -> str:
        """Write pictures, and return them as HTML, side by side where there is room."""
        parts = []
        for picture in pictures:
            write_picture(self._directory, picture)
            parts.append(figure(self._directory, picture))
            self.count += 1
        return figures(parts)

    def _several(self, *modules: Any) -> str:
        return self.draw(chain.from_iterable(each.pictures(self.data) for each in modules))

    def _sensitivity(self) -> str:
        names, found = sensitivities.sensitivity_of(self.data)
        if found is None:
            return paragraph("Sensitivity: too few strings, or all of them are worth the same.")
        return self.draw([matters.picture_of(names, found)])

    def _particles(self, simulate: bool) -> str:
        data = self.data
        if not rank_strings(data).order:
            return paragraph("No string has a result yet.")
        seconds = sample_frames.SECONDS if simulate else 0.0
        best, film, why = rank_strings(data).order[0], None, NO_CLOUD
        try:
            film = sample_frames.frames_of(data, best, seconds)
        except (CampaignError, RuntimeError) as error:
            why = f"No pictures of a sample: {error}"
        shown = sample_frames.final_radii(data, best, seconds)
        both = chain(
            radii.pictures(shown, target_ratio(data)), sample_frames.cloud_pictures(data, film)
        )
        return self.draw(both) + ("" if film else paragraph(why))
