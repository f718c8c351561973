"""The command `agglom accuracy`: plan a study, simulate it on all ranks, write the report."""

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy import (
    control_volume,
    extremes,
    published_method,
    search_history,
    time_integration,
)
from agglom_mpi.accuracy.document import Chapter, Header, ReportSection, write_document
from agglom_mpi.accuracy.ensemble import ensemble_section
from agglom_mpi.accuracy.run_times import busy_lines
from agglom_mpi.accuracy.study import (
    Rows,
    Setup,
    Study,
    StudyDisplay,
    closed,
    completed,
    scene_error,
)
from agglom_mpi.analysis.tables import time_on_free_core, wall_over_cpu
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.errors import require_library
from agglom_mpi.formatting import format_duration, pluralise
from agglom_mpi.runtime.file_setup import check_writable
from agglom_mpi.runtime.leg import RunRequest
from agglom_mpi.runtime.run import run_on_all_ranks
from agglom_mpi.storage.reader import CampaignData, read_campaign, read_inversion
from agglom_mpi.variables import TEN, volume_fraction

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm

SAMPLES: Final = "samples.h5"
"""Campaign file of the study, in the directory of the report."""

LIBRARIES: Final = {"matplotlib": "figures", "pandas": "tables", "jinja2": "documents"}
"""Optional libraries that a report needs, and what for."""


class StudySize(NamedTuple):
    """How much a study measures.

    Attributes
    ----------
    samples : int
        Of every time stepper, number of particles and end time.
    pool : int
        Of the event engine: the pool that ensembles are drawn from.
    again : int
        Fresh samples of every string that a search held for the best.
    extreme : int
        Of every extreme scene.
    budget : float
        Particle-steps after which a set-up ends early.
    """

    samples: int
    pool: int
    again: int
    extreme: int
    budget: float


QUICK: Final = StudySize(samples=60, pool=300, again=60, extreme=4, budget=5e7)
FULL: Final = StudySize(samples=1000, pool=4000, again=400, extreme=20, budget=4e9)


class AccuracyOptions(NamedTuple):
    """Options of `agglom accuracy`, as `cli/accuracy.py` declares them."""

    sources: tuple[str, ...]
    out: str
    settings: Mapping[str, float | str]
    samples: int | None = None
    quick: bool = False
    history: str | None = None
    max_walltime: float | None = None
    quiet: bool = False
    accept_code_change: bool = False
    database: str | None = None
    allow_code: bool = False
    map: str | None = None
    """Planes to map, separated by commas; None: no map."""


class StudyPlan(NamedTuple):
    """Everything to measure: a scene, a campaign's history, extreme scenes; each may be absent."""

    campaign: Campaign | None
    parameters: NDArray[np.float64]
    history: CampaignData | None
    scenes: dict[str, Campaign]
    study: Study
    quick: bool
    numbers: Mapping[str, float] = {}
    """Numbers of the scene that the string gives, in SI units, by path."""


def accuracy(options: AccuracyOptions, world: "Intracomm | None") -> int:
    """Measure and report on all ranks; return the exit code."""
    display = StudyDisplay(options.quiet)
    plans: list[StudyPlan] = []

    def read() -> RunRequest:
        require_report()
        plans.append(make_plan(options))
        directory = Path(options.out)
        directory.mkdir(parents=True, exist_ok=True)
        check_writable(directory / SAMPLES)
        path = directory / SAMPLES
        return RunRequest(plans[0].study, path, options.accept_code_change, options.database)

    def finish(request: RunRequest) -> None:
        display.message("writing the report")
        path = write_report(plans[0], options, read_campaign(request.path))
        display.message(f"{path} with its figures and tables")

    return run_on_all_ranks(read, display, finish, world, max_walltime=options.max_walltime)


def require_report() -> None:
    """Raise a MissingLibraryError if a library that reports need is not installed."""
    for library, purpose in LIBRARIES.items():
        require_library(library, "report", purpose)


def make_plan(options: AccuracyOptions) -> StudyPlan:
    """Read the sources and list the set-ups.

    Raises
    ------
    CampaignError
        If a source, a value or the history cannot be used.
    """
    size = QUICK if options.quick else FULL
    if options.samples is not None:
        pool = max(size.pool, options.samples)
        size = size._replace(samples=options.samples, pool=pool, again=options.samples)
    campaign, scenes = _read_sources(options.sources, options.allow_code)
    for option, given in (("--set", options.settings), ("--history", options.history)):
        if campaign is None and given:
            message = "is for a scene or campaign; all sources are directories"
            raise CampaignError(Problem("agglom accuracy", None, option, message))
    parameters, numbers = np.zeros(0), dict[str, float]()
    if campaign is not None:
        string = campaign.parameters(options.settings)
        values = campaign.variables.used_values(string)
        numbers = {name: values[name] for name in campaign.variables.of_scene}
        campaign, parameters = closed(campaign, string)
    scenes = {name: closed(scene, scene.parameters())[0] for name, scene in scenes.items()}
    history = read_inversion(options.history, options.allow_code) if options.history else None
    setups: dict[str, Setup] = {}
    if campaign is not None:
        setups |= _scene_setups(campaign, parameters, size, options.quick)
    if history is not None:
        setups |= search_history.setups(
            history, size.again, campaign.user_function if campaign else None
        )
    setups |= extremes.setups(scenes, size.extreme)
    first = campaign or next(iter(scenes.values()))
    study = Study(first, setups, size.budget)
    return StudyPlan(campaign, parameters, history, scenes, study, options.quick, numbers)


def _scene_setups(
    campaign: Campaign, parameters: NDArray[np.float64], size: StudySize, quick: bool
) -> dict[str, Setup]:
    """Return the set-ups of the sections on one scene."""
    refused = scene_error(Setup(campaign, parameters, 1))
    if refused:
        raise CampaignError(Problem(campaign.name, None, "scene", refused))
    setups = time_integration.setups(campaign, parameters, size.samples, quick)
    event = time_integration.EVENT
    setups[event] = setups[event]._replace(samples=max(size.pool, size.samples))
    setups |= control_volume.setups(campaign, parameters, size.samples, quick)
    if not quick:
        setups |= published_method.setups(campaign, parameters, size.samples)
    return setups


def _read_sources(
    sources: tuple[str, ...], allow_code: bool
) -> tuple[Campaign | None, dict[str, Campaign]]:
    """Return the campaign of the one file among the sources, and the scenes of the directories."""
    files = [source for source in sources if not Path(source).is_dir()]
    if len(files) > 1:
        message = f"is a second file; one scene or campaign at a time, besides {files[0]}"
        raise CampaignError(Problem(files[1], None, "SOURCE", message))
    scenes: dict[str, Campaign] = {}
    for source in sources:
        if source not in files:
            found = extremes.read_scenes(Path(source), allow_code)
            if not found:
                message = "is a directory without any scene; allowed: one with *.yaml files"
                raise CampaignError(Problem(source, None, "SOURCE", message))
            scenes |= found
    return load_campaign(files[0], allow_code) if files else None, scenes


def write_report(plan: StudyPlan, options: AccuracyOptions, file: CampaignData) -> Path:
    """Write the report of a finished study; return its path."""
    samples = plan.study.collect(file)
    chapters = []
    if plan.campaign is not None:
        chapters.append(Chapter("Error against run time", tuple(_scene_sections(plan, samples))))
    if plan.scenes:
        section = extremes.extremes_section(plan.scenes, samples)
        chapters.append(Chapter("Stiff and extreme cases", (section,)))
    header = Header(
        f"Accuracy: {plan.study.campaign.title or plan.study.campaign.name}"
        if plan.campaign
        else "Accuracy: stiff and extreme scenes",
        shlex.join(command_words(options)),
        (*_facts(plan, file), *_busy(file, chapters)),
    )
    return write_document(Path(options.out), header, chapters)


def _scene_sections(plan: StudyPlan, samples: Mapping[str, Rows]) -> Iterator[ReportSection]:
    """Yield error against run time of one scene, in the order of the report.

    The quick study leaves out what would compile further kernels.
    """
    campaign, parameters, quick = plan.campaign, plan.parameters, plan.quick
    assert campaign is not None
    yield time_integration.time_integration_section(campaign, parameters, samples, quick)
    if not quick:
        yield published_method.end_to_end(campaign, samples)
    yield ensemble_section(campaign, completed(samples[time_integration.EVENT]), quick)
    yield control_volume.control_volume_section(campaign, parameters, samples, quick)
    if plan.history is not None:
        yield search_history.search_history_section(plan.history, samples)


def command_words(options: AccuracyOptions) -> list[str]:
    """Return the words of the command line that asks for these options."""
    words = ["agglom", "accuracy", *options.sources, "--out", options.out]
    for name, value in options.settings.items():
        words += ["--set", f"{name}={value}"]
    if options.samples is not None:
        words += ["--samples", str(options.samples)]
    if options.history is not None:
        words += ["--history", options.history]
    if options.allow_code:
        words.append("--allow-code")
    if options.quick:
        words.append("--quick")
    return words if options.map is None else [*words, "--map", options.map]


def _facts(plan: StudyPlan, file: CampaignData) -> Iterator[str]:
    """Yield what was measured, and how long it took."""
    if plan.campaign is not None:
        values = TEN.values_by_name(plan.parameters)
        fraction = volume_fraction(values["size_ratio"], plan.campaign.scene.third_moment)
        yield f"{plan.campaign.scene.particles} particles, volume fraction {fraction:.3g}"
        yield ", ".join(
            f"{variable.name} {values[variable.name]:.6g}"
            f"{'' if variable.unit == '1' else ' ' + variable.unit}"
            for variable in TEN.variables
            if variable.name in plan.campaign.variables.used
        )
        if plan.numbers:
            yield ", ".join(f"{name} {value:.6g} (SI)" for name, value in plan.numbers.items())
    ranks, rows = int(file.legs()["ranks"].max()), file.all_sample_rows()
    time = format_duration(float(time_on_free_core(rows).sum()))
    yield (
        f"{'quick' if plan.quick else 'full'} study: {len(plan.study.setups)} set-ups, "
        f"{len(rows)} samples, {time} of processor time on {pluralise(ranks, 'rank')}"
    )


def _busy(file: CampaignData, chapters: list[Chapter]) -> list[str]:
    sections = [section for chapter in chapters for section in chapter.sections]
    return busy_lines(wall_over_cpu(file.all_sample_rows()), sections)
