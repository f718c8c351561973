"""`agglom accuracy --map`: simulate stability maps level by level on all ranks, write the report.

Each level of cells is a study of its own, with its own file: its cells follow from the samples of
the levels before, and a run that was stopped goes on.
"""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from agglom_mpi.accuracy import extremes
from agglom_mpi.accuracy.command import AccuracyOptions, command_words, require_report
from agglom_mpi.accuracy.document import Chapter, Header, write_document
from agglom_mpi.accuracy.law_maps import LAW_MAPS
from agglom_mpi.accuracy.map_scene import MapScene, file_text, map_scene
from agglom_mpi.accuracy.planes import PLANES, Values
from agglom_mpi.accuracy.stability_map import FULL, QUICK, MapSize, PlaneMap, map_section, slug
from agglom_mpi.accuracy.study import Rows, Setup, Study, StudyDisplay, closed
from agglom_mpi.analysis.tables import time_on_free_core
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.errors import BAD_INPUT, FINISHED, UserError, error_text
from agglom_mpi.formatting import format_duration, pluralise
from agglom_mpi.report.sections.published import read_published
from agglom_mpi.runtime.file_setup import check_writable
from agglom_mpi.runtime.leg import RunRequest
from agglom_mpi.runtime.run import run_on_all_ranks
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.storage.files import replace_file
from agglom_mpi.storage.reader import read_campaign

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm

BUDGET: Final = 2e8
"""Particle-steps after which a cell needs no more than the fewest samples."""

CELLS: Final = "cells"
"""Directory of the campaign files of failing cells, in that of the report."""

ALL: Final = "all"
"""Name that stands for all planes."""


def map_accuracy(options: AccuracyOptions, world: "Intracomm | None") -> int:
    """Simulate the maps on all ranks and write the report; return the exit code."""
    display = StudyDisplay(options.quiet)
    size, stop = QUICK if options.quick else FULL, StopRequest(options.max_walltime)
    run = MapRun(
        options, size if options.samples is None else size._replace(samples=options.samples)
    )
    if not run.needs_samples:
        return run.write_laws(display) if world is None or world.rank == 0 else FINISHED
    for level in range(size.levels):
        run.level = level
        code = run_on_all_ranks(run.request, display, run.take, world, stop=stop)
        if code != FINISHED:
            return code
    if run.is_planned:
        display.message("writing the report")
        display.message(f"{run.write()} with its figures and tables")
    return FINISHED


class MapRun:
    """The levels of the maps that a command line asks for; rank 0 alone plans them.

    Attributes
    ----------
    level
        Level under way.
    """

    def __init__(self, options: AccuracyOptions, size: MapSize) -> None:
        self.level = 0
        self._options = options
        self._size = size
        self._maps: dict[str, PlaneMap] = {}
        self._laws: tuple[str, ...] = ()
        self._last: RunRequest | None = None
        self._seconds: list[float] = []
        self._samples = 0

    @property
    def needs_samples(self) -> bool:
        """Whether anything is to be simulated, as every rank knows from the command line."""
        asked = (self._options.map or ALL).split(",")
        return any(name.strip() not in LAW_MAPS for name in asked)

    def write_laws(self, display: StudyDisplay) -> int:
        """Write the report where it has maps of laws alone; return the exit code."""
        try:
            self._plan()
        except (UserError, OSError) as error:
            display.error(error_text(error))
            return error.exit_code if isinstance(error, UserError) else BAD_INPUT
        display.message(f"{self.write()} with its figures and tables")
        return FINISHED

    @property
    def is_planned(self) -> bool:
        """Whether this rank plans the maps."""
        return bool(self._maps or self._laws)

    def request(self) -> RunRequest:
        """Return the study of this level; where there is nothing to refine, the one before.

        Raises
        ------
        CampaignError
            If a source, a plane or a value cannot be used.
        """
        if self.level == 0:
            self._plan()
        path = Path(self._options.out) / f"map_{self.level}.h5"
        setups: dict[str, Setup] = {}
        for plane_map in self._maps.values():
            setups |= plane_map.setups(self.level)
        if not setups and self._last is not None:
            return self._last
        check_writable(path)
        study = Study(self.source, setups, BUDGET)
        self._last = RunRequest(
            study, path, self._options.accept_code_change, self._options.database
        )
        return self._last

    def take(self, request: RunRequest) -> None:
        """Take the samples of the level."""
        file = read_campaign(request.path)
        assert isinstance(request.experiment, Study)
        samples: Mapping[str, Rows] = request.experiment.collect(file)
        for plane_map in self._maps.values():
            plane_map.take(self.level, samples)
        rows = file.all_sample_rows()
        self._seconds.append(float(time_on_free_core(rows).sum()))
        self._samples += len(rows)

    def write(self) -> Path:
        """Write the report; return its path."""
        directory = Path(self._options.out)
        sections = []
        for plane_map in self._maps.values():
            lines = dict(self._reproduced(plane_map, directory))
            sections.append(map_section(plane_map, self._scenes, lines))
        for name in self._laws:
            sections.append(LAW_MAPS[name](self.scene, self._options.quick))
        facts = (
            f"{pluralise(self._samples, 'sample')}, {format_duration(sum(self._seconds))} of "
            "processor time",
        )
        header = Header(
            f"Stability maps: {self.source.title or self.source.name}",
            shlex.join(command_words(self._options)),
            facts,
        )
        return write_document(directory, header, [Chapter("Stability maps", tuple(sections))])

    def _plan(self) -> None:
        """Read the sources and the names of the planes."""
        options = self._options
        require_report()
        names = plane_names(options.map or ALL)
        files = [name for name in options.sources if not (Path(name).is_dir() or _is_table(name))]
        if not files:
            message = "is no file of a scene; a map is made of one scene or campaign"
            raise CampaignError(Problem(options.sources[0], None, "SOURCE", message))
        self.source = load_campaign(files[0], options.allow_code)
        size = self._size
        self.scene: MapScene = map_scene(
            self.source, options.settings, size.grains, size.budget, options.allow_code
        )
        self._scenes = dict(_points(self.source, options))
        self._laws = tuple(name for name in names if name in LAW_MAPS)
        for name in names:
            if name in PLANES:
                refusal = PLANES[name].refusal(self.scene)
                if refusal and options.map != ALL:
                    raise CampaignError(Problem(files[0], None, f"--map {name}", refusal))
                if not refusal:
                    self._maps[name] = PlaneMap(PLANES[name], self.scene, size)
        Path(options.out).mkdir(parents=True, exist_ok=True)

    def _reproduced(self, plane_map: PlaneMap, directory: Path) -> Iterator[tuple[str, str]]:
        """Write a failing cell of each method as a campaign file; yield the commands to run it."""
        for method in plane_map.results:
            cell = plane_map.failing_cell(method)
            campaign = None if cell is None else plane_map.campaign(cell, method)
            if cell is None or campaign is None:
                continue
            x, y = plane_map.numbers(cell)
            plane = plane_map.plane
            title = f"{method}: {plane.x.label} {x:.3g}, {plane.y.label} {y:.3g}"
            (directory / CELLS).mkdir(exist_ok=True)
            path = directory / CELLS / f"{plane.name}_{slug(method)}.yaml"
            replace_file(path, file_text(campaign, title).encode())
            yield method, f"agglom simulate {shlex.quote(str(path))} --samples {self._size.samples}"


def plane_names(text: str) -> tuple[str, ...]:
    """Return the planes and laws that a list of names, separated by commas, asks for.

    Raises
    ------
    CampaignError
        If one is unknown.
    """
    known = (*PLANES, *LAW_MAPS)
    if text == ALL:
        return known
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in known:
            message = f"is {name!r}; allowed: {', '.join((ALL, *known))}"
            raise CampaignError(Problem("agglom accuracy", None, "--map", message))
    return names


def _points(
    source: Campaign, options: AccuracyOptions
) -> Iterator[tuple[str, tuple[SceneSection, Values]]]:
    """Yield the scenes that are points on the maps: that of the map itself, and further sources."""
    paths = [Path(name) for name in options.sources if _is_table(name)]
    tables = [(path.stem, list(read_published(path).strings())) for path in paths]
    yield source.name, _point(source, options.settings)
    yield from _published_rows(source, tables)
    for name in options.sources:
        if Path(name).is_dir():
            for scene, campaign in extremes.read_scenes(Path(name), options.allow_code).items():
                yield scene, _point(campaign, {})
        elif name != source.name and not _is_table(name):
            campaign = load_campaign(name, options.allow_code)
            yield name, _point(campaign, {})
            yield from _published_rows(campaign, tables)


def _is_table(source: str) -> bool:
    return source.endswith(".json")


def _published_rows(
    campaign: Campaign, tables: Sequence[tuple[str, Sequence[Values]]]
) -> Iterator[tuple[str, tuple[SceneSection, Values]]]:
    """Yield the rows of tables whose variables are those of a campaign, in its scene."""
    for name, rows in tables:
        for number, row in enumerate(rows, 1):
            if set(row) == set(campaign.variables.used):
                yield f"{name} row {number}", _point(campaign, row)


def _point(campaign: Campaign, settings: Mapping[str, float | str]) -> tuple[SceneSection, Values]:
    closed_campaign, string = closed(campaign, campaign.parameters(settings))
    section, values = closed_campaign.at(string)
    return section, values
