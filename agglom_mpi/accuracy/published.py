"""The numerical method as the papers have it, for any scene: what ours is compared with."""

from typing import Final

from agglom_mpi.config.scene import AdaptiveEngine, Engine, FixedEngine, SceneSection
from agglom_mpi.config.submodels import IterationSolver

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
    changes: dict[str, object] = {"engine": _engine(scene)}
    if scene.restitution.law == "pressure":
        changes["solver"] = IterationSolver(law="iteration")
    if scene.cooling.law != "none":
        changes["cooling"] = scene.cooling.model_copy(update={"integration": "euler"})
    return scene.model_copy(update=changes)


def _engine(scene: SceneSection) -> Engine:
    if scene.restitution.law == "pressure" and scene.duration.law == "mean_speed":
        return FixedEngine(steps=200)
    if isinstance(scene.end_time, str):
        return AdaptiveEngine()
    return AdaptiveEngine(floor=FLOOR * scene.end_time, ceiling=CEILING * scene.end_time)
