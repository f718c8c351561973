"""The papers' numerical method for any scene, and stiff and extreme scenes by it and by ours."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from agglom_mpi.accuracy.report import ReportSection, RowColumn, Sentences, time_text
from agglom_mpi.accuracy.soundness import CLOSED, heaped_overlaps, summary, troubles
from agglom_mpi.accuracy.study import Rows, Setup, StudyPart, with_scene
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_mean
from agglom_mpi.physics.impact_solvers import FixedPointIteration
from agglom_mpi.simulation.engines import AdaptiveSteps, Engine, EventDriven, FixedSteps
from agglom_mpi.statistics import MeanEstimate

FLOOR: Final = 1e-4
CEILING: Final = 0.1
"""Shortest and longest step of [B 6.14] over the end time: 1e-6 and 1e-3 s of 0.01 s."""

METHODS: Final = ("ours", "published")


def as_published(scene: SceneSection) -> SceneSection:
    """Return the same physics, box and start with the published numerical method.

    - Impacts: the fixed point e ← G(e) from e = 0, to 1e-6, at most 100 times  [A 20] [B 6b]. A
      constant restitution has nothing to solve.
    - Cooling: one forward Euler step per time step  [A 19] [B 6.21].
    - Time: 200 equal steps where the impact lasts as in [A 12]; otherwise [B 6.14]'s adaptive
      steps. Their limits are [B]'s in proportion to the end time, so that a scene of nanoseconds or
      of years gets as many steps as the paper's; as printed where the end time is `characteristic`,
      which [B] does not have. A box in shear has no time steps, and keeps its engine.

    What the papers model otherwise (escape, heating, whose energy breaks) stays as the scene has
    it: the methods are compared on the same equations.
    """
    engine: Engine
    if scene.escape.is_sheared():
        engine = scene.engine
    elif scene.restitution.uses_contact_pressure and scene.duration.takes_published_steps:
        engine = FixedSteps(steps=200)
    elif isinstance(scene.end_time, str):
        engine = AdaptiveSteps()
    else:
        engine = AdaptiveSteps(floor=FLOOR * scene.end_time, ceiling=CEILING * scene.end_time)
    changes: dict[str, object] = {"engine": engine, "cooling": scene.cooling.stepped()}
    if scene.restitution.uses_contact_pressure:
        changes["solver"] = FixedPointIteration()
    return scene.model_copy(update=changes)


def event_engine(campaign: Campaign) -> Engine:
    """Return the event engine of a campaign, its own if it has one."""
    engine = campaign.scene.engine
    return EventDriven() if engine.has_time_steps else engine


def read_scenes(directory: Path, allow_code: bool = False) -> dict[str, Campaign]:
    """Return the scenes of a directory by file stem; raise a CampaignError if one is wrong."""
    return {path.stem: load_campaign(path, allow_code) for path in sorted(directory.glob("*.yaml"))}


def published_name(scene: str) -> str:
    """Return the name of the set-up that runs a scene as published."""
    return f"{scene}, as published"


def extremes_part(scenes: Mapping[str, Campaign], samples: int) -> StudyPart:
    """Return the part on extreme scenes: each by this package's method, and as published."""
    setups = {}
    for name, campaign in scenes.items():
        parameters = campaign.parameters()
        published = with_scene(campaign, **dict(as_published(campaign.scene)))
        if campaign.scene.engine.has_time_steps:  # the steps are what is extreme
            published = with_scene(published, engine=campaign.scene.engine)
        setups[name] = Setup(campaign, parameters, samples, event_engine(campaign))
        setups[published_name(name)] = Setup(published, parameters, samples)
    return StudyPart(setups, lambda found: _section(scenes, found))


def _section(scenes: Mapping[str, Campaign], samples: Mapping[str, Rows]) -> ReportSection:
    rows, wrong = [], []
    for name, campaign in scenes.items():
        row: dict[str, Any] = {"scene": name, "what": campaign.title}
        found = [summary(samples[each]) for each in (name, published_name(name))]
        for method, own in zip(METHODS, found, strict=True):
            row |= {f"{method}: {key}": value for key, value in own.items()}
            text = "; ".join(troubles(own, heaped_overlaps(found[0])).values())
            wrong.append({"scene": name, "method": method, "troubles": text})
        rows.append(row)
    texts = {(one["scene"], one["method"]): one["troubles"] or "sound" for one in wrong}
    published = [one["troubles"] for one in wrong if one["method"] == "published"]
    sentences = Sentences(
        "extremes",
        closed=CLOSED,
        scenes=len(rows),
        troubled=[one for one in wrong if one["troubles"]],
        sound={
            method: sum(texts[name, method] == "sound" for name in scenes) for method in METHODS
        },
        unsolved=sum("impacts unsolved" in text for text in published),
        below_zero=sum("below zero" in text for text in published),
        overlaps=sum("overlaps" in text for text in published),
        energy_error=np.fmax.reduce([row["ours: energy error"] for row in rows]),
    )
    columns = (
        RowColumn("scene", format=lambda row: f"`{row['scene']}`: {row['what']}", text=True),
        RowColumn("ours: b/b⁰", format=lambda row: _growth(row, "ours")),
        RowColumn("ours", format=lambda row: texts[row["scene"], "ours"], text=True),
        Column("ours: energy error", "energy error", format=".1g"),
        Column("ours: collisions per sample", "collisions", format=".3g"),
        RowColumn("processor time", format=lambda row: time_text(_of_method(row, "ours"))),
        RowColumn("published: b/b⁰", format=lambda row: _growth(row, "published")),
        RowColumn("published", format=lambda row: texts[row["scene"], "published"], text=True),
    )
    table = Table(columns, rows, "One row is one scene.", "extremes")
    return sentences.section("Stiff and extreme scenes", tables=[table])


def _of_method(row: Mapping[str, Any], method: str) -> dict[str, Any]:
    return {name.removeprefix(f"{method}: "): value for name, value in row.items()}


def _growth(row: Any, method: str) -> str:
    good = row[f"{method}: samples"] - row[f"{method}: failed"]
    mean = row[f"{method}: mean b/b0"], row[f"{method}: standard error"]
    return format_mean(MeanEstimate(*mean, good))
