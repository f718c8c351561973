"""The command `agglom accuracy` without `--map` and `--answer`: one scene, and extreme ones."""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from agglom_mpi.accuracy.answer.command import answer_accuracy
from agglom_mpi.accuracy.maps.command import map_accuracy
from agglom_mpi.accuracy.report import busy_lines, require_report, write_document
from agglom_mpi.accuracy.study import (
    Setup,
    Stages,
    Study,
    StudyOptions,
    StudyPart,
    closed,
    require_steps,
    run_stages,
    scene_error,
)
from agglom_mpi.accuracy.time_integration.control_volume import control_volume_part
from agglom_mpi.accuracy.time_integration.ensemble import ensemble_part
from agglom_mpi.accuracy.time_integration.published_method import extremes_part, read_scenes
from agglom_mpi.accuracy.time_integration.search_history import history_part
from agglom_mpi.accuracy.time_integration.steps import StudiedScene, steps_part
from agglom_mpi.analysis.tables import time_on_free_core, wall_over_cpu
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.formatting import format_duration, in_unit, pluralise
from agglom_mpi.storage.reader import CampaignData, read_inversion
from agglom_mpi.variables import TEN, volume_fraction

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm

SAMPLES: Final = "samples.h5"
"""Campaign file of the study, in the directory of the report."""


QUICK: Final = (60, 300, 60, 4, 5e7)
"""Size of a quick study: samples of every time stepper, number of particles and end time; of the
event engine, the pool that ensembles are drawn from; of every string that a search held for the
best; of every extreme scene; and particle-steps after which a set-up ends early."""
FULL: Final = (1000, 4000, 400, 20, 4e9)
"""The same of a full study."""


def accuracy(options: StudyOptions, world: "Intracomm | None") -> int:
    """Measure and report on all ranks; return the exit code."""
    if options.answer:
        return answer_accuracy(options, world)
    if options.map is not None:
        return map_accuracy(options, world)
    return run_stages(options, world, lambda: scene_study(options))


def scene_study(options: StudyOptions) -> Stages:
    """Read the sources, yield one study of all set-ups, and write its report.

    Raises
    ------
    CampaignError
        If a source, a value or the history cannot be used.
    """
    require_report()
    samples, pool, again, extreme, budget = QUICK if options.quick else FULL
    if options.samples is not None:
        samples = again = options.samples
        pool = max(pool, samples)
    campaign, scenes = _read_sources(options)
    facts, chapters = list[str](), dict[str, list[StudyPart]]()
    for each in scenes.values():
        each.require_one_scene("SOURCE")
    if campaign is not None:
        require_steps(campaign)
        string = campaign.parameters(options.settings)
        values = campaign.variables.used_values(string)
        numbers = {name: values[name] for name in campaign.variables.of_scene}
        scene = StudiedScene(*closed(campaign, string), samples, pool, options.quick)
        facts = list(_facts(scene, numbers))
        if refused := scene_error(Setup(scene.campaign, scene.parameters, 1)):
            raise CampaignError(Problem(scene.campaign.name, None, "scene", refused))
        parts = [steps_part(scene), ensemble_part(scene), control_volume_part(scene)]
        if options.history:
            history = read_inversion(options.history, options.allow_code)
            parts.append(history_part(history, again, campaign.user_function))
        chapters["Error against run time"] = parts
    if scenes:
        scenes = {name: closed(each, each.parameters())[0] for name, each in scenes.items()}
        chapters["Stiff and extreme cases"] = [extremes_part(scenes, extreme)]
    first = next(iter(scenes.values())) if campaign is None else scene.campaign
    setups: dict[str, Setup] = {}
    for part in (part for parts in chapters.values() for part in parts):
        setups |= part.setups
    study = Study(first, setups, budget)
    Path(options.out).mkdir(parents=True, exist_ok=True)
    file = yield SAMPLES, study
    rows = study.collect(file)
    sections = {title: [part.section(rows) for part in parts] for title, parts in chapters.items()}
    title = "stiff and extreme scenes" if campaign is None else first.title or first.name
    done = _extent(study, file, options.quick)
    busy = busy_lines(wall_over_cpu(file.all_sample_rows()))
    facts = [shlex.join(options.words()), *facts, done, *busy]
    return write_document(Path(options.out), f"Accuracy: {title}", facts, sections)


def _read_sources(options: StudyOptions) -> tuple[Campaign | None, dict[str, Campaign]]:
    """Return the campaign of the one file among the sources, and the scenes of the directories."""
    files = [source for source in options.sources if not Path(source).is_dir()]
    if len(files) > 1:
        message = f"is a second file; one scene or campaign at a time, besides {files[0]}"
        raise CampaignError(Problem(files[1], None, "SOURCE", message))
    scenes: dict[str, Campaign] = {}
    for source in options.sources:
        if source not in files:
            found = read_scenes(Path(source), options.allow_code)
            if not found:
                message = "is a directory without any scene; allowed: one with *.yaml files"
                raise CampaignError(Problem(source, None, "SOURCE", message))
            scenes |= found
    for option, given in (("--set", options.settings), ("--history", options.history)):
        if given and not files:
            message = "is for a scene or campaign; all sources are directories"
            raise CampaignError(Problem("agglom accuracy", None, option, message))
    return load_campaign(files[0], options.allow_code) if files else None, scenes


def _facts(scene: "StudiedScene", numbers: dict[str, float]) -> Iterator[str]:
    """Yield what is measured, with the numbers of the scene that the string gave, in SI units."""
    campaign, values = scene.campaign, TEN.values_by_name(scene.parameters)
    fraction = volume_fraction(values["size_ratio"], campaign.scene.third_moment)
    yield f"{campaign.scene.particles} particles, volume fraction {fraction:.3g}"
    yield ", ".join(
        f"{variable.name} {in_unit(f'{values[variable.name]:.6g}', variable.unit)}"
        for variable in TEN.variables
        if variable.name in campaign.variables.used
    )
    if numbers:
        yield ", ".join(f"{name} {value:.6g} (SI)" for name, value in numbers.items())


def _extent(study: Study, file: CampaignData, quick: bool) -> str:
    ranks, rows = int(file.legs()["ranks"].max()), file.all_sample_rows()
    time = format_duration(float(time_on_free_core(rows).sum()))
    return (
        f"{'quick' if quick else 'full'} study: {len(study.setups)} set-ups, "
        f"{len(rows)} samples, {time} of processor time on {pluralise(ranks, 'rank')}"
    )
