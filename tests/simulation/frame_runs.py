"""Samples that are looked at on the way, of scene types that other tests compile too."""

import numpy as np
from scenes import (
    CONSTANT,
    FLOOR,
    HALF,
    breaking_adaptive_reentry,
    breaking_event_periodic,
    make_scene,
)

from agglom_mpi.physics.contact import MeanSpeedDuration
from agglom_mpi.physics.friction import ConstantFriction, RestitutionScaledFriction
from agglom_mpi.physics.hardness import ArrheniusHardness
from agglom_mpi.physics.restitution import ConstantRestitution
from agglom_mpi.physics.velocities import UniformX
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.engines import FixedSteps
from agglom_mpi.simulation.frames import Frames, new_frames
from agglom_mpi.simulation.sample import simulate_scene

CROWD = {"particles": 50, "size_ratio": 0.7, "end_time": 2.0**-9}
STEPS = 128
"""Of a length that is a power of two, so that its multiples are exact."""


def stepping(restitution, steps=STEPS, **options):
    laws = CONSTANT._replace(restitution=ConstantRestitution.Numbers(restitution))
    return make_scene(laws, FixedSteps.Numbers(steps), Periodic.Numbers(), **(CROWD | options))


def quickstart(hardness=1e7, **options):
    """Return a scene of the type that `jobs/quickstart.yaml` has, which is compiled anyway."""
    scene = flying(hardness, **options)
    laws = scene.laws._replace(
        duration=MeanSpeedDuration.Numbers(1e-6),
        friction=RestitutionScaledFriction.Numbers(0.0),
        fragmentation=None,
    )
    return scene._replace(
        velocities=UniformX.Numbers(scene.velocities.relative_speed), laws=laws, cooling=None
    )


def flying(hardness, **options):
    """Return a scene of the event engine without friction; the hard bounce elastically."""
    scene = breaking_event_periodic(**(CROWD | options))
    laws = scene.laws._replace(
        hardness=ArrheniusHardness.Numbers(hardness, 0.0),
        friction=ConstantFriction.Numbers(0.0),
    )
    return scene._replace(laws=laws)


HARD, SOFT = 1e60, 1.0
"""Hardnesses in Pa at which nothing and everything bonds."""

SCENES = {
    "quickstart": quickstart(speed=40.0),
    "event": breaking_event_periodic(**CROWD),
    "event, all bounce": flying(HARD),
    "event, all bond": flying(SOFT),
    "fixed": stepping(0.9),
    "fixed, all bond": stepping(0.0),
    "adaptive": breaking_adaptive_reentry(2.0 * FLOOR, 20.0 * FLOOR, **CROWD),
}


SMALL = quickstart(SOFT, particles=6, size_ratio=0.8, speed=40.0)
SMALL_TIMES = np.linspace(0.0, SMALL.end_time, 9)


def looked_at(scene, seed, times):
    """Record, final particles and frames of a sample."""
    frames = new_frames(np.array(times, dtype=float), scene.particles)
    record, particles = simulate_scene(scene, np.random.default_rng(seed), frames=frames)
    return record, particles, frames


def unseen(scene, seed):
    """Record and final particles of a sample that nobody looks at."""
    return simulate_scene(scene, np.random.default_rng(seed))


def bits(particles):
    """What a final state is, as bytes."""
    n = int(particles.size[0])
    parts = [particles.position[:, :n].T, particles.velocity[:, :n].T, particles.radius[:n]]
    parts.append(particles.mass[:n])
    parts += [a[:n] for a in (particles.temperature, particles.grains) if a is not None]
    return [np.ascontiguousarray(part).tobytes() for part in parts]


def bits_of_frame(frames, f, particles):
    """Those of a frame, to be compared with the `bits` of `particles`."""
    n = int(frames.particles[f])
    parts = [frames.positions, frames.velocities, frames.radii, frames.masses]
    parts += [frames.temperatures] * (particles.temperature is not None)
    parts += [frames.grains] * (particles.grains is not None)
    return [np.ascontiguousarray(part[f, :n]).tobytes() for part in parts]


def arrays_of(frames):
    """Return the arrays that there are, without spins where grains have none."""
    return [each for each in frames if each is not None]


def filled(frames, f):
    """One frame without the places that nobody is in."""
    n = int(frames.particles[f])
    rest = (None if each is None else each[f, :n] for each in frames[2:])
    return Frames(frames.times[f], n, *rest)


def wrapped(positions):
    """Positions in m, put back into the periodic box."""
    return positions - 2.0 * HALF * np.rint(positions / (2.0 * HALF))
