"""`agglom accuracy --map`: simulate stability maps level by level on all ranks, write the report.

Each level of cells is a study of its own, with its own file: its cells follow from the samples of
the levels before, and a run that was stopped goes on.
"""

import re
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from agglom_mpi.accuracy.maps.laws import LAW_PLANES, law_section
from agglom_mpi.accuracy.maps.plane_map import FULL, QUICK, MapSize, PlaneMap
from agglom_mpi.accuracy.maps.planes import PLANES
from agglom_mpi.accuracy.maps.scene import Values, file_text, map_scene
from agglom_mpi.accuracy.maps.section import plane_section
from agglom_mpi.accuracy.report import require_report, write_document
from agglom_mpi.accuracy.study import (
    Setup,
    Stages,
    Study,
    StudyOptions,
    closed,
    require_steps,
    run_stages,
)
from agglom_mpi.accuracy.time_integration.published_method import read_scenes
from agglom_mpi.analysis.tables import time_on_free_core
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.formatting import format_duration, pluralise
from agglom_mpi.report.sections.published import read_published
from agglom_mpi.storage.files import replace_file

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm

BUDGET: Final = 2e8
"""Particle-steps after which a cell needs no more than the fewest samples."""

CELLS: Final = "cells"
"""Directory of the campaign files of failing cells, in that of the report."""

ALL: Final = "all"
"""Name that stands for all planes."""


def map_accuracy(options: StudyOptions, world: "Intracomm | None") -> int:
    """Simulate the maps on all ranks and write the report; return the exit code."""
    size = QUICK if options.quick else FULL
    if options.samples is not None:
        size = size._replace(samples=options.samples)
    levels = size.levels if needs_samples(options.map or ALL) else 0
    return run_stages(options, world, lambda: map_study(options, size), levels)


def map_study(options: StudyOptions, size: MapSize) -> Stages:
    """Read the sources and the names of the planes, yield a study for each level, and report.

    Where there is nothing to refine, the study of a level is the one before.

    Raises
    ------
    CampaignError
        If a source, a plane or a value cannot be used.
    """
    require_report()
    names = plane_names(options.map or ALL)
    files = [name for name in options.sources if not (Path(name).is_dir() or _is_table(name))]
    if not files:
        message = "is no file of a scene; a map is made of one scene or campaign"
        raise CampaignError(Problem(options.sources[0], None, "SOURCE", message))
    source = load_campaign(files[0], options.allow_code)
    require_steps(source)
    scene = map_scene(source, options.settings, size.grains, size.budget)
    scenes = dict(_points(source, options))
    maps = []
    for plane in (PLANES[name] for name in names if name in PLANES):
        refusal = plane.refusal(scene)
        if not refusal:
            maps.append(PlaneMap(plane, scene, size))
        elif options.map != ALL:
            raise CampaignError(Problem(files[0], None, f"--map {plane.name}", refusal))
    directory = Path(options.out)
    directory.mkdir(parents=True, exist_ok=True)
    seconds, samples, stage = 0.0, 0, None
    for level in range(size.levels if maps else 0):
        setups: dict[str, Setup] = {}
        for plane_map in maps:
            setups |= plane_map.setups(level)
        if setups or stage is None:
            stage = f"map_{level}.h5", Study(source, setups, BUDGET)
        file = yield stage
        found = stage[1].collect(file)
        for plane_map in maps:
            plane_map.take(level, found)
        rows = file.all_sample_rows()
        seconds, samples = seconds + float(time_on_free_core(rows).sum()), samples + len(rows)
    sections = [
        plane_section(each, scenes, dict(_reproduced(each, directory, size.samples)))
        for each in maps
    ]
    sections += [
        law_section(LAW_PLANES[name](scene), options.quick) for name in names if name in LAW_PLANES
    ]
    spent = f"{pluralise(samples, 'sample')}, {format_duration(seconds)} of processor time"
    title = f"Stability maps: {source.title or source.name}"
    facts = [shlex.join(options.words()), spent]
    return write_document(directory, title, facts, {"Stability maps": sections})


def _reproduced(plane_map: PlaneMap, directory: Path, samples: int) -> Iterator[tuple[str, str]]:
    """Write a failing cell of each method as a campaign file; yield the commands to run it."""
    plane = plane_map.plane
    for method in plane_map.results:
        cell = plane_map.failing_cell(method)
        campaign = None if cell is None else plane_map.campaign(cell, method)
        if cell is None or campaign is None:
            continue
        x, y = plane_map.numbers(cell)
        title = f"{method}: {plane.x.label} {x:.3g}, {plane.y.label} {y:.3g}"
        (directory / CELLS).mkdir(exist_ok=True)
        slug = re.sub(r"[^a-z0-9]+", "_", method.lower()).strip("_")
        path = directory / CELLS / f"{plane.name}_{slug}.yaml"
        replace_file(path, file_text(campaign, title).encode())
        yield method, f"agglom simulate {shlex.quote(str(path))} --samples {samples}"


def needs_samples(planes: str) -> bool:
    """Return whether anything is to be simulated for a list of planes, as every rank knows."""
    return any(name.strip() not in LAW_PLANES for name in planes.split(","))


def plane_names(text: str) -> tuple[str, ...]:
    """Return the planes and laws that a list of names, separated by commas, asks for.

    Raises
    ------
    CampaignError
        If one is unknown.
    """
    known = (*PLANES, *LAW_PLANES)
    if text == ALL:
        return known
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in known:
            message = f"is {name!r}; allowed: {', '.join((ALL, *known))}"
            raise CampaignError(Problem("agglom accuracy", None, "--map", message))
    return names


def _points(
    source: Campaign, options: StudyOptions
) -> Iterator[tuple[str, tuple[SceneSection, Values]]]:
    """Yield the scenes that are points on the maps: that of the map itself, and further sources.

    The rows of tables whose variables are those of a campaign are points in its scene.
    """
    campaigns: dict[str, tuple[Campaign, Mapping[str, float | str]]] = {}
    alone: dict[str, Campaign] = {}
    campaigns[source.name] = source, options.settings
    for name in options.sources:
        if Path(name).is_dir():
            alone |= read_scenes(Path(name), options.allow_code)
        elif name != source.name and not _is_table(name):
            campaigns[name] = load_campaign(name, options.allow_code), {}
    tables = [Path(name) for name in options.sources if _is_table(name)]
    rows = [
        (f"{path.stem} row {number}", row)
        for path in tables
        for number, row in enumerate(read_published(path).strings(), 1)
    ]
    for name, (campaign, settings) in campaigns.items():
        yield name, _point(campaign, settings)
        for row_name, row in rows:
            if set(row) == set(campaign.variables.used):
                yield row_name, _point(campaign, row)
    for name, campaign in alone.items():
        yield name, _point(campaign, {})


def _is_table(source: str) -> bool:
    return source.endswith(".json")


def _point(campaign: Campaign, settings: Mapping[str, float | str]) -> tuple[SceneSection, Values]:
    closed_campaign, string = closed(campaign, campaign.parameters(settings))
    section, values = closed_campaign.at(string)
    return section, values
