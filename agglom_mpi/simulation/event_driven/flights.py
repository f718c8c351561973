"""Trajectory and next event of each particle of the event engine."""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.kernels import inlined
from agglom_mpi.simulation.boundary import clamped

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


RANGE: Final = 6
"""Crossing of an oversize particle that has moved as far as its prediction holds."""


@inlined
def load_particle(flights, particles, i, now):
    """Copy position, velocity and radius of particle i at time `now` in s to its trajectory."""
    trajectory = flights.trajectory[i]
    trajectory["x"] = particles.position[0, i]
    trajectory["y"] = particles.position[1, i]
    trajectory["z"] = particles.position[2, i]
    trajectory["time"] = now
    trajectory["radius"] = particles.radius[i]
    load_velocity(flights, particles, i)


@inlined
def load_velocity(flights, particles, i):
    """Copy a changed velocity to the trajectory of particle i and invalidate its prediction."""
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    trajectory["u"] = particles.velocity[0, i]
    trajectory["v"] = particles.velocity[1, i]
    trajectory["w"] = particles.velocity[2, i]
    invalidate_prediction(next_event)


@inlined
def invalidate_prediction(next_event):
    """Invalidate the predictions of and with a particle: its trajectory has changed."""
    next_event["version"] += 1
    next_event["collision_time"] = np.inf
    next_event["partner"] = -1


@inlined
def synchronise_particle(scene, particles, flights, i, now):
    """Move particle i to where it is at `now` in s.

    An oversize particle is wrapped into the box. One in a cell stays on the side of the face
    where the cell is, by rounding at most outside.
    """
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    r, half = particles.position, scene.half_width
    flight = now - trajectory["time"]
    trajectory["x"] += trajectory["u"] * flight
    trajectory["y"] += trajectory["v"] * flight
    trajectory["z"] += trajectory["w"] * flight
    trajectory["time"] = now
    r[0, i] = clamped(scene.escape, trajectory["x"], half)
    r[1, i] = clamped(scene.escape, trajectory["y"], half)
    r[2, i] = clamped(scene.escape, trajectory["z"], half)
    if next_event["oversize"] >= 0:
        trajectory["x"], trajectory["y"], trajectory["z"] = r[0, i], r[1, i], r[2, i]
