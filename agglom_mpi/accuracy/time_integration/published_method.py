"""The papers' numerical method for any scene, and its error in whole samples, end to end."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from agglom_mpi.accuracy.report import (
    ReportSection,
    ReportTable,
    Sentences,
    TableColumn,
    time_columns,
)
from agglom_mpi.accuracy.study import Rows, StudyPart, completed, paired_difference
from agglom_mpi.accuracy.time_integration.steps import EVENT, StudiedScene, event_engine
from agglom_mpi.analysis.tables import time_on_free_core
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.physics.impact_solvers import FixedPointIteration
from agglom_mpi.simulation.engines import AdaptiveSteps, Engine, FixedSteps
from agglom_mpi.statistics import mean_of

FLOOR: Final = 1e-4
CEILING: Final = 0.1
"""Shortest and longest step of [B 6.14] over the end time: 1e-6 and 1e-3 s of 0.01 s."""


def as_published(scene: SceneSection) -> SceneSection:
    """Return the same physics, box and start with the published numerical method.

    - Impacts: the fixed point e ← G(e) from e = 0, to 1e-6, at most 100 times  [A 20] [B 6b]. A
      constant restitution has nothing to solve.
    - Cooling: one forward Euler step per time step  [A 19] [B 6.21].
    - Time: 200 equal steps where the impact lasts as in [A 12]; otherwise [B 6.14]'s adaptive
      steps. Their limits are [B]'s in proportion to the end time, so that a scene of nanoseconds or
      of years gets as many steps as the paper's; as printed where the end time is `characteristic`,
      which [B] does not have.

    What the papers model otherwise (escape, heating, whose energy breaks) stays as the scene has
    it: the methods are compared on the same equations.
    """
    engine: Engine
    if scene.restitution.uses_contact_pressure and scene.duration.takes_published_steps:
        engine = FixedSteps(steps=200)
    elif isinstance(scene.end_time, str):
        engine = AdaptiveSteps()
    else:
        engine = AdaptiveSteps(floor=FLOOR * scene.end_time, ceiling=CEILING * scene.end_time)
    changes: dict[str, object] = {"engine": engine, "cooling": scene.cooling.stepped()}
    if scene.restitution.uses_contact_pressure:
        changes["solver"] = FixedPointIteration()
    return scene.model_copy(update=changes)


ITERATION: Final = "published impact iteration, exact times"
WHOLE: Final = "published iteration, cooling and time steps"


def published_part(scene: StudiedScene) -> StudyPart:
    """Return the part on the published method: its set-ups that differ from the scene."""
    own, published, setups = scene.campaign.scene, as_published(scene.campaign.scene), {}
    if published.solver != own.solver:
        setups[ITERATION] = scene.setup(event_engine(scene.campaign), solver=published.solver)
    if published != own:
        setups[WHOLE] = scene.setup(None, **dict(published))

    def section(samples: Mapping[str, Rows]) -> ReportSection:
        import pandas as pd

        rows = [_row(name, samples[name], samples[EVENT]) for name in setups]
        sentences = Sentences(
            "published_method",
            growth=mean_of(completed(samples[EVENT])["mean_radius_ratio"]),
            engine=published.engine,
            rows=rows,
        )
        frame, caption = pd.DataFrame(rows), "One row is one method."
        table = ReportTable("whole_method", caption, frame, METHOD_COLUMNS)
        return sentences.section("The published method as a whole", tables=[table])

    return StudyPart(setups, section)


def _row(name: str, own: Rows, reference: Rows) -> dict[str, object]:
    """Return bias, failures and cost of a method."""
    good = completed(own)
    bias = paired_difference(own, reference, "mean_radius_ratio")
    collisions = max(1.0, float(np.sum(good["collisions"])))
    return {
        "method": name,
        "samples": len(own),
        "failed": len(own) - len(good),
        "bias of b/b0": bias.value,
        "standard error": bias.error,
        "half width": bias.half_width,
        "pairs": bias.samples,
        "unsolved impacts": float(np.sum(good["capped_iterations"])) / collisions,
        **time_columns("sample", time_on_free_core(own)),
    }


METHOD_COLUMNS: Final = (
    *TableColumn.plain("method"),
    TableColumn.number("samples", ".0f"),
    TableColumn.mean("bias of b/b⁰", "bias of b/b0", "standard error", "pairs"),
    TableColumn.percent("unsolved impacts"),
    TableColumn.time("sample"),
)
