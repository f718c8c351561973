"""Frames of a sample at set times, taken on copies so that nothing else changes.

`recorder` fills them.

A frame shows what a run that ended at its time would leave. The first, at 0, shows the grains as
they are placed; one at the end time shows the final state. In between an engine says what is due,
copies its particles and moves the copies to the time; here they are cooled up to it and written
down. Between events that is exact. Time steps have no state between their ends: there the copies
move straight on from the step's beginning, as they would in a shorter last step.

Without frames a recorder is `None`, and its calls compile to nothing.
"""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.kernels import inlined, inlined_allocating, not_inlined
from agglom_mpi.simulation.collision import cool_until
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.simulation.measurement import to_box_frame
from agglom_mpi.simulation.particles import (
    Ledger,
    Particles,
    compact,
    copy_slot_to,
    new_ledger,
    new_particles,
    value_or,
)

NEVER: Final = np.inf


class FrameRecorder(NamedTuple):
    """Frames that are being filled.

    Attributes
    ----------
    frames
        What is filled.
    taken
        Frames filled so far, shape (1,).
    drift
        Velocity in m/s of the frame of reference that the engine works in, shape (3,).
    copy, ledger
        The particles of the frame that is being taken, and a ledger that nobody reads.
    """

    frames: Frames
    taken: np.ndarray
    drift: np.ndarray
    copy: Particles
    ledger: Ledger


@inlined_allocating
def new_recorder(frames, scene, capacity):
    """Return what fills `frames`, for particles with room for `capacity`; None without frames."""
    if frames is None:
        return None
    copy = new_particles(scene, capacity, frames)
    return FrameRecorder(frames, np.zeros(1, np.int64), np.zeros(3), copy, new_ledger())


@inlined
def next_frame(recorder, end_time):
    """Time in s of the next frame before the end, at which the final state is taken; or inf."""
    times, k = recorder.frames.times, recorder.taken[0]
    return times[k] if k < times.size and times[k] < end_time else NEVER


@inlined
def record_start(recorder, scene, particles):
    """Take the frame at the start, if one is wanted, of the grains just placed."""
    if recorder is not None:
        record_until(recorder, scene, particles, 0.0)


@inlined
def note_drift(recorder, drift):
    """Note the velocity in m/s, three components, of the frame of reference from now on."""
    if recorder is not None:
        for axis in range(3):
            recorder.drift[axis] = drift[axis]


@inlined
def record_end(recorder, scene, particles, end):
    """Take the frames that are left up to the `end` in s that was reached, of the final state."""
    if recorder is not None:
        record_until(recorder, scene, particles, end)


@not_inlined
def record_until(recorder, scene, particles, time):
    """Take all frames up to `time` in s of particles as they are."""
    times = recorder.frames.times
    while recorder.taken[0] < times.size and times[recorder.taken[0]] <= time:
        store_frame(recorder, scene, particles)


@inlined
def copy_all(recorder, particles):
    """Copy the particles, gaps included; the copy."""
    copy = recorder.copy
    for i in range(particles.size[0]):
        copy_slot_to(particles, i, copy, i)
    copy.size[0] = particles.size[0]
    return copy


@not_inlined
def finish(recorder, scene, time):
    """Write down the copies, who are where they are at `time` in s, as a final state is left."""
    cool_copies(recorder, scene, time)
    return_copies(recorder, scene, time)
    store_frame(recorder, scene, recorder.copy)


@not_inlined
def cool_copies(recorder, scene, time):
    """Close the gaps between the copies and cool them up to `time` in s."""
    compact(recorder.copy)
    for i in range(recorder.copy.size[0]):
        cool_until(scene.cooling, scene, recorder.copy, recorder.ledger, i, time)


@not_inlined
def return_copies(recorder, scene, time):
    """Return the copies at `time` in s to the frame of reference of the box."""
    drift = recorder.drift
    to_box_frame(scene, recorder.copy, (drift[0], drift[1], drift[2]), time)


@not_inlined
def store_frame(recorder, scene, particles):
    """Write particles without gaps into the next frame."""
    frames, f = recorder.frames, recorder.taken[0]
    recorder.taken[0] += 1
    frames.particles[f] = particles.size[0]
    for i in range(particles.size[0]):
        for axis in range(3):
            frames.positions[f, i, axis] = particles.position[axis, i]
            frames.velocities[f, i, axis] = particles.velocity[axis, i]
        frames.labels[f, i] = particles.label[i]
        frames.radii[f, i] = particles.radius[i]
        frames.masses[f, i] = particles.mass[i]
        frames.temperatures[f, i] = value_or(particles.temperature, i, scene.temperature)
        by_mass = np.int64(np.rint(particles.mass[i] / scene.mass))
        frames.grains[f, i] = value_or(particles.grains, i, by_mass)
