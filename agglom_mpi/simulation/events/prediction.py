"""When does a particle hit another?  Roots of a quadratic, since motion is ballistic."""

import math
from typing import Final

import numpy as np

from agglom_mpi.compilation import fused_stage, stage
from agglom_mpi.simulation.box import is_periodic, nearest_image
from agglom_mpi.simulation.events.cells import GIANTS
from agglom_mpi.simulation.events.gather import gather
from agglom_mpi.simulation.events.images import heed_images
from agglom_mpi.simulation.events.tournament import set_time

SLACK: Final = 1e-9
"""Share of b² by which b² − ac may be negative from rounding, for whom c is not far above b²/a."""

COARSE: Final = 3.0 * 2.0**-52
"""An approach speed over √(v_i² + v_j²) that rounding may leave behind: (|v_i| + |v_j|) 2⁻⁵³ for
each axis make √6 · 2⁻⁵³ at most, and the quotient of w and d by reach, below d, is no sharper."""


@fused_stage
def squared_cross(dx, dy, dz, du, dv, dw):  # type: ignore[no-untyped-def]
    """Square of the cross product of two vectors."""
    return (dy * dw - dz * dv) ** 2 + (dz * du - dx * dw) ** 2 + (dx * dv - dy * du) ** 2


@stage
def is_resolved(path, other, closing, reach):  # type: ignore[no-untyped-def]
    """Whether two that touch approach by more than their velocities are rounded to.

    An impulse that is too small for the velocities would be repeated for ever.
    """
    squares = path["u"] ** 2 + path["v"] ** 2 + path["w"] ** 2
    squares += other["u"] ** 2 + other["v"] ** 2 + other["w"] ** 2
    return closing * closing > COARSE * COARSE * squares * reach * reach


@fused_stage
def first_hit(scene, movers, near, count, x, y, z, i, now, barred):  # type: ignore[no-untyped-def]
    """Earliest hit of particle i, at (x, y, z) in m now, among `count` others: when, with whom.

    Only hits that come before what the other has in mind count: otherwise the other turns to i
    again when that has happened. Overlapping and approaching is a hit now; receding is none. Of
    hits at the same time, that of the lowest slot is taken.
    `barred` is who has just been hit. A first test that rounding may fail is cheap; who passes it
    is judged by the distance at which the two would pass each other, which loses fewer digits.
    """
    path, plan = movers.path[i], movers.plan[i]
    side, per_side = 2.0 * scene.half_width, 0.5 / scene.half_width
    u, v, w, radius = path["u"], path["v"], path["w"], path["radius"]
    hit_time, partner = plan["hit_time"], -1
    for k in range(count):
        j = near[k]
        other = movers.path[j]
        flight = now - other["time"]
        dx = nearest_image(scene.escape, other["x"] + other["u"] * flight - x, side, per_side)
        dy = nearest_image(scene.escape, other["y"] + other["v"] * flight - y, side, per_side)
        dz = nearest_image(scene.escape, other["z"] + other["w"] * flight - z, side, per_side)
        du, dv, dw = other["u"] - u, other["v"] - v, other["w"] - w
        closing = dx * du + dy * dv + dz * dw
        reach = radius + other["radius"]
        excess = dx * dx + dy * dy + dz * dz - reach * reach
        square = du * du + dv * dv + dw * dw
        likely = (1.0 + SLACK) * closing * closing - square * excess
        if min(-closing, likely) > 0.0:
            miss = squared_cross(dx, dy, dz, du, dv, dw)
            discriminant = square * reach * reach - miss
            time = now + max(0.0, excess) / (math.sqrt(max(0.0, discriminant)) - closing)
            first = time < hit_time or (time == hit_time and j < partner)
            sought = first and discriminant > 0.0 and time < movers.plan[j]["hit_time"]
            if sought and j != barred and (excess > 0.0 or is_resolved(path, other, closing, reach)):
                hit_time = time
                partner = np.int64(j)
    return hit_time, partner


@stage
def look(scene, cells, movers, tournament, i, now, face, barred):  # type: ignore[no-untyped-def]
    """Find whether particle i hits something before what it has in mind, and tell whom it hits."""
    path, plan = movers.path[i], movers.plan[i]
    flight = now - path["time"]
    x = path["x"] + path["u"] * flight
    y = path["y"] + path["v"] * flight
    z = path["z"] + path["w"] * flight
    near = cells.near
    count = gather(scene, cells, path, plan, x, y, z, face)
    hit_time, partner = first_hit(scene, movers, near, count, x, y, z, i, now, barred)
    if partner >= 0:
        note(movers, i, partner, hit_time)
        note(movers, partner, i, hit_time)
        set_time(tournament, partner, min(hit_time, movers.plan[partner]["turn_time"]))
    if is_periodic(scene.escape) and cells.shape[GIANTS] > 0:
        heed_images(scene, cells, movers, count, x, y, z, i, now)
    set_time(tournament, i, min(plan["hit_time"], plan["turn_time"]))


@stage
def note(movers, i, partner, hit_time):  # type: ignore[no-untyped-def]
    """Note that particle i hits `partner` at `hit_time` in s."""
    plan = movers.plan[i]
    plan["hit_time"] = hit_time
    plan["partner"] = partner
    plan["hit_version"] = movers.plan[partner]["version"]
