"""Trajectory and next event of each particle of the event engine."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.compilation.stages import inlined
from agglom_mpi.simulation.boundary import clamped_position, is_sheared
from agglom_mpi.simulation.particles import (
    moved_by,
    position_of,
    set_position,
    set_velocity,
    velocity_of,
)
from agglom_mpi.simulation.shear import put_into_box

TRAJECTORY: Final = np.dtype(
    [(name, "f8") for name in ("x", "y", "z", "u", "v", "w", "time", "radius")]
)
"""Straight flight: position in m at the particle's own `time` in s, velocity in m/s, radius in m.

One cache line, and all that comparing a pair needs.
"""

NEXT_EVENT: Final = np.dtype(
    [
        ("collision_time", "f8"),
        ("crossing_time", "f8"),
        ("version", "i8"),
        ("partner_version", "i8"),
        ("partner", "i4"),
        ("crossing", "i4"),
        ("a", "i4"),
        ("b", "i4"),
        ("c", "i4"),
        ("oversize", "i4"),
        ("padding", "i8"),
    ]
)
"""The next event of a particle, padded to a cache line.

Its earliest known collision: time in s, `partner`, and the `version` that the partner had then; a
version changes with the trajectory, which invalidates collisions predicted before. Its next
`crossing`: the face of its cell that it leaves, or `RANGE`, and the time in s. Its cell (a, b, c),
or its index in the list of oversize particles, else −1.
"""


class Flights(NamedTuple):
    """Records of `TRAJECTORY` and of `NEXT_EVENT`, shape (capacity,)."""

    trajectory: np.ndarray
    next_event: np.ndarray


CACHE_LINE: Final = 64
"""Bytes that a processor reads from memory at once."""


def new_flights(capacity: int) -> Flights:
    """Return room for the trajectories and next events of `capacity` particles."""
    return Flights(new_lines(capacity, TRAJECTORY), new_lines(capacity, NEXT_EVENT))


def new_lines(count: int, kind: np.dtype[np.void]) -> NDArray[np.void]:
    """Return `count` empty records of a kind that fills cache lines, each in one of its own."""
    room = np.zeros(count * kind.itemsize + CACHE_LINE, np.uint8)
    begin = -room.ctypes.data % CACHE_LINE
    return room[begin : begin + count * kind.itemsize].view(kind)


RANGE: Final = 6
"""Crossing of an oversize particle that has moved as far as its prediction holds."""

BELOW: Final = 2
"""Crossing through the lower face of a cell along y."""


@inlined
def load_particle(flights, particles, i, now):
    """Copy position, velocity and radius of particle i at time `now` in s to its trajectory."""
    trajectory, particle = flights.trajectory[i], particles.records[i]
    set_position(trajectory, position_of(particle))
    trajectory["time"] = now
    trajectory["radius"] = particle["radius"]
    load_velocity(flights, particles, i)


@inlined
def load_velocity(flights, particles, i):
    """Copy a changed velocity to the trajectory of particle i and invalidate its prediction."""
    set_velocity(flights.trajectory[i], velocity_of(particles.records[i]))
    invalidate_prediction(flights.next_event[i])


@inlined
def invalidate_prediction(next_event):
    """Invalidate the predictions of and with a particle: its trajectory has changed."""
    next_event["version"] += 1
    next_event["collision_time"] = np.inf
    next_event["partner"] = -1


@inlined
def synchronise_particle(scene, particles, ledger, flights, i, now):
    """Move particle i to where it is at `now` in s.

    An oversize particle is wrapped into the box. One in a cell stays on the side of the face
    where the cell is, by rounding at most outside.
    """
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    flight = now - trajectory["time"]
    set_position(trajectory, moved_by(trajectory, flight, velocity_of(trajectory)))
    trajectory["time"] = now
    inside = clamped_position(scene.escape, scene, position_of(trajectory))
    set_position(particles.records[i], inside)
    if next_event["oversize"] >= 0:
        set_position(trajectory, inside)
        if is_sheared(scene.escape):
            put_into_box(scene, particles.records[i], ledger, now)
            copy_motion(trajectory, particles.records[i])


@inlined
def copy_motion(trajectory, particle):
    """Copy the position and velocity of a particle to its trajectory, whose time is the same."""
    set_position(trajectory, position_of(particle))
    set_velocity(trajectory, velocity_of(particle))
