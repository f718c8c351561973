"""Recording of frames at set times, on copies so that nothing else changes.

A frame shows what a run that ended at its time would leave. The first, at 0, shows the grains as
they are placed; one at the end time shows the final state. In between an engine says what is due,
copies its particles and moves the copies to the time; here they are cooled up to it and stored.
Between events that is exact. Time steps have no state between their ends: there the copies move
straight on from the step's beginning, as they would in a shorter last step.

Without frames a recorder is `None`, and its calls compile to nothing.
"""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.kernels import inlined, inlined_allocating, not_inlined
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
from agglom_mpi.simulation.temperature import cool_until

NEVER: Final = np.inf


class FrameRecorder(NamedTuple):
    """Frames that are being filled.

    Attributes
    ----------
    frames
        What is filled.
    stored
        Frames filled so far, shape (1,).
    drift
        Velocity in m/s of the frame of reference that the engine works in, shape (3,).
    copy, ledger
        Copies of the particles for the next frame, and the ledger of their cooling, not of the run.
    """

    frames: Frames
    stored: np.ndarray
    drift: np.ndarray
    copy: Particles
    ledger: Ledger


@inlined_allocating
def new_recorder(frames, scene, capacity):
    """Return the recorder of `frames` with room for `capacity` particles; None without frames."""
    if frames is None:
        return None
    copy = new_particles(scene, capacity, frames)
    return FrameRecorder(frames, np.zeros(1, np.int64), np.zeros(3), copy, new_ledger())


@inlined
def next_frame_time(recorder, end_time):
    """Time in s of the next frame before the end, inf without one; the end is recorded apart."""
    times, k = recorder.frames.times, recorder.stored[0]
    return times[k] if k < times.size and times[k] < end_time else NEVER


@inlined
def record_start(recorder, scene, particles):
    """Store the frame at 0, if there is one, of the grains just placed."""
    if recorder is not None:
        store_frames_until(recorder, scene, particles, 0.0)


@inlined
def set_drift(recorder, drift):
    """Set the velocity in m/s, three components, of the frame of reference."""
    if recorder is not None:
        for axis in range(3):
            recorder.drift[axis] = drift[axis]


@inlined
def record_end(recorder, scene, particles, end):
    """Store the remaining frames up to the time reached `end` in s, of the final state."""
    if recorder is not None:
        store_frames_until(recorder, scene, particles, end)


@not_inlined
def store_frames_until(recorder, scene, particles, time):
    """Store all frames up to `time` in s of particles as they are."""
    times = recorder.frames.times
    while recorder.stored[0] < times.size and times[recorder.stored[0]] <= time:
        store_frame(recorder, scene, particles)


@inlined
def copy_particles(recorder, particles):
    """Copy the particles, gaps included, and return the copies."""
    copy = recorder.copy
    for i in range(particles.size[0]):
        copy_slot_to(particles, i, copy, i)
    copy.size[0] = particles.size[0]
    return copy


@not_inlined
def finish_frame(recorder, scene, time):
    """Cool the copies, which are moved to `time` in s, change to the box frame and store them."""
    cool_copies(recorder, scene, time)
    return_copies_to_box(recorder, scene, time)
    store_frame(recorder, scene, recorder.copy)


@not_inlined
def cool_copies(recorder, scene, time):
    """Close the gaps between the copies and cool them up to `time` in s."""
    compact(recorder.copy)
    for i in range(recorder.copy.size[0]):
        cool_until(scene.cooling, scene, recorder.copy, recorder.ledger, i, time)


@not_inlined
def return_copies_to_box(recorder, scene, time):
    """Return the copies at `time` in s to the frame of reference of the box."""
    drift = recorder.drift
    to_box_frame(scene, recorder.copy, (drift[0], drift[1], drift[2]), time)


@not_inlined
def store_frame(recorder, scene, particles):
    """Store particles without gaps in the next frame."""
    frames, f = recorder.frames, recorder.stored[0]
    recorder.stored[0] += 1
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
