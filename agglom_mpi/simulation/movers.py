"""A particle as the event engine sees it: where it was last, and what happens to it next."""

from typing import Final

import numpy as np

from agglom_mpi.compilation import stage
from agglom_mpi.simulation.box import drawn_in

MOVER: Final = np.dtype(
    [
        ("x", "f8"),
        ("y", "f8"),
        ("z", "f8"),
        ("u", "f8"),
        ("v", "f8"),
        ("w", "f8"),
        ("time", "f8"),
        ("radius", "f8"),
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
        ("unused", "i8"),
    ],
    align=True,
)
"""One particle in two cache lines.

Position in m at its own `time` in s, velocity in m/s, radius in m. Its earliest known hit: when,
with which `partner`, and the `version` the partner had then; a particle's version changes with its
velocity, so that a hit noted before is known to be void. Its next `turn`, the face of its cell that
it leaves or `RANGE`, and when. The cell (a, b, c), or its place in the list of giants, else −1.
"""

RANGE: Final = 6
"""The turn of a giant that has moved as far as its prediction holds."""


@stage
def load_mover(movers, particles, i, now):  # type: ignore[no-untyped-def]
    """Take over position, velocity and radius of particle i at time `now` in s."""
    mover = movers[i]
    mover["x"] = particles.position[0, i]
    mover["y"] = particles.position[1, i]
    mover["z"] = particles.position[2, i]
    mover["time"] = now
    mover["radius"] = particles.radius[i]
    load_velocity(movers, particles, i)


@stage
def load_velocity(movers, particles, i):  # type: ignore[no-untyped-def]
    """Take over a changed velocity: what was predicted for particle i is void."""
    mover = movers[i]
    mover["u"] = particles.velocity[0, i]
    mover["v"] = particles.velocity[1, i]
    mover["w"] = particles.velocity[2, i]
    void(mover)


@stage
def void(mover):  # type: ignore[no-untyped-def]
    """Void what was predicted: the path of the particle is another one now."""
    mover["version"] += 1
    mover["hit_time"] = np.inf
    mover["partner"] = -1


@stage
def catch_up_position(scene, particles, movers, i, now):  # type: ignore[no-untyped-def]
    """Move particle i to where it is at `now` in s.

    A giant comes back into the box. Who lives in a cell stays on the side of the face where the
    cell is, by rounding at most outside.
    """
    mover = movers[i]
    r, half = particles.position, scene.half_width
    flight = now - mover["time"]
    mover["x"] += mover["u"] * flight
    mover["y"] += mover["v"] * flight
    mover["z"] += mover["w"] * flight
    mover["time"] = now
    r[0, i] = drawn_in(scene.escape, mover["x"], half)
    r[1, i] = drawn_in(scene.escape, mover["y"], half)
    r[2, i] = drawn_in(scene.escape, mover["z"], half)
    if mover["giant"] >= 0:
        mover["x"], mover["y"], mover["z"] = r[0, i], r[1, i], r[2, i]
