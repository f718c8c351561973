"""A particle as the event engine sees it: where it was last, and what happens to it next."""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.compilation import stage
from agglom_mpi.simulation.box import drawn_in

PATH: Final = np.dtype([(name, "f8") for name in ("x", "y", "z", "u", "v", "w", "time", "radius")])
"""Where a particle flies: position in m at its own `time` in s, velocity in m/s, radius in m.

One cache line, and all that comparing a pair needs.
"""

PLAN: Final = np.dtype(
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
        ("giant", "i4"),
        ("padding", "i8"),
    ]
)
"""What a particle does next.

Its earliest known hit: when, with which `partner`, and the `version` the partner had then; a
particle's version changes with its path, so that a hit noted before is known to be void. Its next
`turn`, the face of its cell that it leaves or `RANGE`, and when. The cell (a, b, c), or its place
in the list of giants, else −1. Padded to a cache line.
"""


class Movers(NamedTuple):
    """Records of `PATH` and of `PLAN`, shape (capacity,)."""

    path: np.ndarray
    plan: np.ndarray


RANGE: Final = 6
"""The turn of a giant that has moved as far as its prediction holds."""


@stage
def load_mover(movers, particles, i, now):  # type: ignore[no-untyped-def]
    """Take over position, velocity and radius of particle i at time `now` in s."""
    path = movers.path[i]
    path["x"] = particles.position[0, i]
    path["y"] = particles.position[1, i]
    path["z"] = particles.position[2, i]
    path["time"] = now
    path["radius"] = particles.radius[i]
    load_velocity(movers, particles, i)


@stage
def load_velocity(movers, particles, i):  # type: ignore[no-untyped-def]
    """Take over a changed velocity: what was predicted for particle i is void."""
    path, plan = movers.path[i], movers.plan[i]
    path["u"] = particles.velocity[0, i]
    path["v"] = particles.velocity[1, i]
    path["w"] = particles.velocity[2, i]
    void(plan)


@stage
def void(plan):  # type: ignore[no-untyped-def]
    """Void what was predicted: the path of the particle is another one now."""
    plan["version"] += 1
    plan["hit_time"] = np.inf
    plan["partner"] = -1


@stage
def catch_up_position(scene, particles, movers, i, now):  # type: ignore[no-untyped-def]
    """Move particle i to where it is at `now` in s.

    A giant comes back into the box. Who lives in a cell stays on the side of the face where the
    cell is, by rounding at most outside.
    """
    path, plan = movers.path[i], movers.plan[i]
    r, half = particles.position, scene.half_width
    flight = now - path["time"]
    path["x"] += path["u"] * flight
    path["y"] += path["v"] * flight
    path["z"] += path["w"] * flight
    path["time"] = now
    r[0, i] = drawn_in(scene.escape, path["x"], half)
    r[1, i] = drawn_in(scene.escape, path["y"], half)
    r[2, i] = drawn_in(scene.escape, path["z"], half)
    if plan["giant"] >= 0:
        path["x"], path["y"], path["z"] = r[0, i], r[1, i], r[2, i]
