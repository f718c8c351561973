"""The papers' numerical method for any scene."""

from typing import Final

from agglom_mpi.config.scene import SceneSection
from agglom_mpi.physics.impact_solvers import FixedPointIteration
from agglom_mpi.simulation.engines import AdaptiveSteps, Engine, FixedSteps

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
