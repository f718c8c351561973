"""A particle as the event engine sees it: where it was last, and what happens to it next."""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.kernels import inlined
from agglom_mpi.simulation.boundary import clamped

TRAJECTORY: Final = np.dtype(
    [(name, "f8") for name in ("x", "y", "z", "u", "v", "w", "time", "radius")]
)
"""Where a particle flies: position in m at its own `time` in s, velocity in m/s, radius in m.

One cache line, and all that comparing a pair needs.
"""

NEXT_EVENT: Final = np.dtype(
    [
        ("hit_time", "f8"),
        ("turn_time", "f8"),
        ("version", "i8"),
        ("hit_version", "i8"),
        ("partner", "i4"),
        ("turn", "i4"),
        ("a", "i4"),
        ("b", "i4"),
        ("c", "i4"),
        ("oversize", "i4"),
        ("padding", "i8"),
    ]
)
"""What a particle does next.

Its earliest known hit: when, with which `partner`, and the `version` the partner had then; a
particle's version changes with its trajectory, so that a hit noted before is known to be void.
Its next `turn`, the face of its cell that it leaves or `RANGE`, and when. The cell (a, b, c), or
the place in the list of oversize particles, else −1. Padded to a cache line.
"""


class Flights(NamedTuple):
    """Records of `TRAJECTORY` and of `NEXT_EVENT`, shape (capacity,)."""

    trajectory: np.ndarray
    next_event: np.ndarray


RANGE: Final = 6
"""The turn of an oversize particle that has moved as far as its prediction holds."""


@inlined
def load_flight(flights, particles, i, now):
    """Take over position, velocity and radius of particle i at time `now` in s."""
    trajectory = flights.trajectory[i]
    trajectory["x"] = particles.position[0, i]
    trajectory["y"] = particles.position[1, i]
    trajectory["z"] = particles.position[2, i]
    trajectory["time"] = now
    trajectory["radius"] = particles.radius[i]
    load_velocity(flights, particles, i)


@inlined
def load_velocity(flights, particles, i):
    """Take over a changed velocity: what was predicted for particle i is void."""
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    trajectory["u"] = particles.velocity[0, i]
    trajectory["v"] = particles.velocity[1, i]
    trajectory["w"] = particles.velocity[2, i]
    void_event(next_event)


@inlined
def void_event(next_event):
    """Void what was predicted: the trajectory of the particle is another one now."""
    next_event["version"] += 1
    next_event["hit_time"] = np.inf
    next_event["partner"] = -1


@inlined
def catch_up_position(scene, particles, flights, i, now):
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
