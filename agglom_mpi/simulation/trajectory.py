"""Frames at set times, taken of copies so that nothing else changes.

A frame shows what a run that ended at its time would leave. The first, at 0, shows the grains as
they are placed; one at the end time shows the final state. In between an engine stops at the time
of a frame, copies its particles and moves the copies there; here they are cooled up to it and
stored. Between events that is exact. Time steps have no state between their ends: there the copies
move straight on from the step's beginning, as they would in a shorter last step.
"""

from typing import Any, NamedTuple

import numpy as np

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.compilation.stages import inlined, not_inlined
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.simulation.particles import (
    Ledger,
    Particles,
    compact,
    new_ledger,
    new_particles,
)
from agglom_mpi.simulation.reference_frame import to_box_frame
from agglom_mpi.simulation.scene import copy_at
from agglom_mpi.simulation.temperature import cool_until


class Observer(NamedTuple):
    """Copies of the particles at one time.

    Attributes
    ----------
    drift
        Velocity in m/s of the frame of reference that the engine works in, shape (3,).
    copy, ledger
        The copies, and the ledger of their cooling, not of the run.
    """

    drift: np.ndarray
    copy: Particles
    ledger: Ledger


def new_observer(scene: Any, capacity: int) -> Observer:
    """Return an observer of a run of a `Scene` with room for `capacity` particles."""
    return Observer(np.zeros(3), new_particles(scene, capacity), new_ledger())


@kernel
def observe_particles(scene, particles, engine_state, observer, time):
    """Copy the particles as they are at `time` in s, up to which a run has come.

    Parameters
    ----------
    scene : Scene
    particles : Particles, unchanged
    engine_state : the state of the scene's engine
    observer : Observer; its copy holds the particles in the frame of reference of the box
    time : float, s
    """
    observe(scene, particles, engine_state, observer, time)


@inlined
def observe(scene, particles, engine_state, observer, time):
    """Copy the particles as they are at a time, cooled and in the frame of the box."""
    copy_at(scene.engine, scene, particles, engine_state, observer, time)
    cool_copies(observer, scene, time)
    return_copies_to_box(observer, scene, time)


@inlined
def copy_particles(observer, particles):
    """Copy the particles, gaps included, and return the copies."""
    copy = observer.copy
    for i in range(particles.size[0]):
        copy.records[i] = particles.records[i]
    copy.size[0] = particles.size[0]
    return copy


@not_inlined
def cool_copies(observer, scene, time):
    """Close the gaps between the copies and cool them up to `time` in s."""
    compact(observer.copy)
    for i in range(observer.copy.size[0]):
        cool_until(scene.cooling, scene, observer.copy.records[i], observer.ledger, time)


@not_inlined
def return_copies_to_box(observer, scene, time):
    """Return the copies at `time` in s to the frame of reference of the box."""
    to_box_frame(scene, observer.copy, observer.drift, time)


def store_frame(frames: Frames, f: int, scene: Any, particles: Particles) -> None:
    """Store particles without gaps in frame `f`."""
    n = int(particles.size[0])
    frames.particles[f] = n
    frames.positions[f, :n] = particles.position[:, :n].T
    frames.velocities[f, :n] = particles.velocity[:, :n].T
    if frames.spins is not None and particles.spin is not None:
        frames.spins[f, :n] = particles.spin[:, :n].T
    frames.labels[f, :n] = particles.label[:n]
    frames.radii[f, :n] = particles.radius[:n]
    frames.masses[f, :n] = particles.mass[:n]
    if particles.temperature is None:
        frames.temperatures[f, :n] = scene.temperature
    else:
        frames.temperatures[f, :n] = particles.temperature[:n]
    if particles.grains is None:
        frames.grains[f, :n] = np.rint(particles.mass[:n] / scene.mass)
    else:
        frames.grains[f, :n] = particles.grains[:n]
