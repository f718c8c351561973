"""What an accuracy study consists of, from what the user asked."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy import box, extremes, inversion, time_integration, whole_method
from agglom_mpi.accuracy.study import Study
from agglom_mpi.accuracy.trials import Trial, refusal
from agglom_mpi.config.campaign import Campaign, load_campaign
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.storage.reader import CampaignData, read_inversion


class Extent(NamedTuple):
    """How much a study measures.

    Attributes
    ----------
    samples : int
        Of every time stepper and box.
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


QUICK: Final = Extent(samples=60, pool=300, again=60, extreme=4, budget=5e7)
FULL: Final = Extent(samples=1000, pool=4000, again=400, extreme=20, budget=4e9)


class Options(NamedTuple):
    """What `agglom accuracy` was asked for."""

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


class Plan(NamedTuple):
    """Everything to measure: a scene, a campaign's history, extreme scenes; each may be absent."""

    campaign: Campaign | None
    parameters: NDArray[np.float64]
    history: CampaignData | None
    scenes: dict[str, Campaign]
    study: Study
    quick: bool


def make_plan(options: Options) -> Plan:
    """Read the sources and list the trials; raises the user's mistakes."""
    extent = QUICK if options.quick else FULL
    if options.samples is not None:
        extent = extent._replace(
            samples=options.samples, pool=max(extent.pool, options.samples), again=options.samples
        )
    campaign, scenes = _read(options.sources, options.allow_code)
    parameters = campaign.parameters(options.settings) if campaign else np.zeros(0)
    history = read_inversion(options.history) if options.history else None
    trials: dict[str, Trial] = {}
    if campaign is not None:
        refused = refusal(Trial(campaign, parameters, 1))
        if refused:
            raise CampaignError(Problem(campaign.name, None, "scene", refused))
        trials |= time_integration.trials(campaign, parameters, extent.samples, options.quick)
        event = time_integration.EVENT
        trials[event] = trials[event]._replace(samples=max(extent.pool, extent.samples))
        trials |= box.trials(campaign, parameters, extent.samples, options.quick)
        if not options.quick:
            trials |= whole_method.trials(campaign, parameters, extent.samples)
    if history is not None:
        trials |= inversion.trials(
            history, extent.again, campaign.user_function if campaign else None
        )
    trials |= extremes.trials(scenes, extent.extreme)
    first = campaign or next(iter(scenes.values()))
    study = Study(first, trials, extent.budget)
    return Plan(campaign, parameters, history, scenes, study, options.quick)


def _read(
    sources: tuple[str, ...], allow_code: bool
) -> tuple[Campaign | None, dict[str, Campaign]]:
    """Campaign or scene of the one file among the sources, and the scenes of the directories."""
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
