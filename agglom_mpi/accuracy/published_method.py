"""The papers' numerical method for any scene, and its error in whole samples, end to end."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.document import ReportSection, ReportTable, Sentences, TableColumn
from agglom_mpi.accuracy.run_times import shown_time, time_columns
from agglom_mpi.accuracy.study import Rows, Setup, completed, paired_difference, with_scene
from agglom_mpi.accuracy.time_integration import EVENT, event_engine
from agglom_mpi.analysis.tables import time_on_free_core
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.formatting import format_percent
from agglom_mpi.physics.impact_solvers import FixedPointIteration
from agglom_mpi.simulation.engines import AdaptiveSteps, Engine, FixedSteps
from agglom_mpi.statistics import mean_of

if TYPE_CHECKING:
    import pandas as pd

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
    changes: dict[str, object] = {"engine": _published_engine(scene)}
    if scene.restitution.uses_contact_pressure:
        changes["solver"] = FixedPointIteration()
    changes["cooling"] = scene.cooling.stepped()
    return scene.model_copy(update=changes)


def _published_engine(scene: SceneSection) -> Engine:
    """Return the paper's time steps for a scene; see `as_published`."""
    if scene.restitution.uses_contact_pressure and scene.duration.takes_published_steps:
        return FixedSteps(steps=200)
    if isinstance(scene.end_time, str):
        return AdaptiveSteps()
    return AdaptiveSteps(floor=FLOOR * scene.end_time, ceiling=CEILING * scene.end_time)


ITERATION: Final = "published impact iteration, exact times"
WHOLE: Final = "published iteration, cooling and time steps"


def setups(campaign: Campaign, parameters: NDArray[np.float64], samples: int) -> dict[str, Setup]:
    """Return the set-ups of the section; only those that differ from the scene."""
    published = as_published(campaign.scene)
    chosen = {}
    if published.solver != campaign.scene.solver:
        iterated = with_scene(campaign, solver=published.solver)
        chosen[ITERATION] = Setup(iterated, parameters, samples, event_engine(campaign))
    if published != campaign.scene:
        chosen[WHOLE] = Setup(with_scene(campaign, **dict(published)), parameters, samples)
    return chosen


def end_to_end(campaign: Campaign, samples: Mapping[str, Rows]) -> ReportSection:
    """Return the section on the published method.

    Parameters
    ----------
    campaign
    samples
        Rows of each of `setups`, and of the event engine.
    """
    frame = measure(samples)
    reference = mean_of(completed(samples[EVENT])["mean_radius_ratio"])
    sentences = Sentences(
        "published_method",
        growth=reference,
        engine=as_published(campaign.scene).engine,
        rows=[row for _, row in frame.iterrows()],
    )
    return sentences.section(
        title="The published method as a whole",
        tables=(ReportTable("whole_method", "One row is one method.", frame, COLUMNS),),
    )


def measure(samples: Mapping[str, Rows]) -> "pd.DataFrame":
    """Return bias, failures and cost of each method that ran, one row each."""
    import pandas as pd

    rows = []
    for name in (ITERATION, WHOLE):
        if name not in samples:
            continue
        own = samples[name]
        good = completed(own)
        bias = paired_difference(own, samples[EVENT], "mean_radius_ratio")
        collisions = max(1.0, float(np.sum(good["collisions"])))
        rows.append(
            {
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
        )
    return pd.DataFrame(rows)


COLUMNS: Final = (
    TableColumn("method", lambda row: row["method"]),
    TableColumn.number("samples", ".0f"),
    TableColumn.mean("bias of b/b⁰", "bias of b/b0", "standard error", "pairs"),
    TableColumn("unsolved impacts", lambda row: format_percent(row["unsolved impacts"])),
    shown_time("sample"),
)
