"""In which frame may a scene be simulated?

In that of the centre of mass, if nothing asks for another: a drifting cloud crosses cells for
nothing, and a drift a million times the other velocities takes six digits from them.
"""

from agglom_mpi.compilation import Submodel, question, stage
from agglom_mpi.physics.fragmentation import OwnEnergyFragmentation, PairEnergyFragmentation
from agglom_mpi.physics.heating import OwnEnergy, PairSplit
from agglom_mpi.simulation.box import Periodic, Reentry, inside
from agglom_mpi.simulation.measures import total_momentum
from agglom_mpi.simulation.scene import AdaptiveSteps, EventDriven, FixedSteps


@question
def sees_frame(model: Submodel | None) -> bool:
    """Whether a submodel's results depend on the frame of reference.

    Those of time steps do: they shift overlapping spheres along their velocities  [A 8].
    """


@sees_frame.answer(None, Periodic, PairSplit, PairEnergyFragmentation, EventDriven)
def _galilean(model):  # type: ignore[no-untyped-def]
    return False


@sees_frame.answer(Reentry, OwnEnergy, OwnEnergyFragmentation, FixedSteps, AdaptiveSteps)
def _at_rest(model):  # type: ignore[no-untyped-def]
    return True


@stage
def enter_frame(scene, particles):  # type: ignore[no-untyped-def]
    """Go to the centre-of-mass frame where the scene allows it; its velocity in m/s."""
    laws = scene.laws
    if sees_frame(scene.engine) or sees_frame(scene.escape):
        return 0.0, 0.0, 0.0
    if sees_frame(laws.heating) or sees_frame(laws.fragmentation):
        return 0.0, 0.0, 0.0
    momentum, mass = total_momentum(particles)
    drift = (momentum[0] / mass, momentum[1] / mass, momentum[2] / mass)
    for axis in range(3):
        for i in range(particles.size[0]):
            particles.velocity[axis, i] -= drift[axis]
    return drift


@stage
def leave_frame(scene, particles, drift, time):  # type: ignore[no-untyped-def]
    """Return to the frame of the box after `time` in s.

    Everybody moves by the same rounded way, so that neighbours stay apart after a million boxes.
    """
    for axis in range(3):
        if drift[axis] != 0.0:
            way = inside(scene.escape, drift[axis] * time, scene.half_width)
            for i in range(particles.size[0]):
                particles.velocity[axis, i] += drift[axis]
                moved = particles.position[axis, i] + way
                particles.position[axis, i] = inside(scene.escape, moved, scene.half_width)
