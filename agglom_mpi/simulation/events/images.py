"""When may another image of somebody large be touched?  In a small periodic box, before long."""

from typing import Final

import numpy as np

from agglom_mpi.compilation import stage
from agglom_mpi.simulation.box import nearest_image
from agglom_mpi.simulation.events.cells import ALONG
from agglom_mpi.simulation.events.movers import RANGE

BEYOND: Final = 1.0 + 1e-9
"""Share of D at which the nearest image is another one for certain, so that a look finds it."""


@stage
def safe_reach(scene, cells):  # type: ignore[no-untyped-def]
    """Sum of two radii in m up to which the nearest image stays the only one until the next look.

    Without cells none is safe: nobody looks again before an image says so.

    One moves by its range, the other by its range or a cell at most; the next image is at least D
    away along an axis.
    """
    along = cells.shape[ALONG]
    if along == 0:
        return -np.inf
    return scene.half_width - 2.0 * scene.half_width / along - cells.range[0]


@stage
def heed_images(scene, cells, movers, count, x, y, z, i, now):  # type: ignore[no-untyped-def]
    """Let particle i look around again before it may touch another image of somebody large."""
    path, plan = movers.path[i], movers.plan[i]
    if path["radius"] + cells.largest[0] > safe_reach(scene, cells):
        time = first_image(scene, cells, movers, count, x, y, z, i, now)
        if time < plan["turn_time"]:
            plan["turn_time"] = time
            plan["turn"] = RANGE


@stage
def first_image(scene, cells, movers, count, x, y, z, i, now):  # type: ignore[no-untyped-def]
    """Time in s from which another image of someone too large to be safe may touch i."""
    side, half = 2.0 * scene.half_width, scene.half_width
    per_side = 1.0 / side
    path = movers.path[i]
    safe = safe_reach(scene, cells)
    first = np.inf
    for k in range(count):
        other = movers.path[cells.near[k]]
        reach = path["radius"] + other["radius"]
        if cells.near[k] == i or reach <= safe:
            continue
        flight = now - other["time"]
        dx = nearest_image(scene.escape, other["x"] + other["u"] * flight - x, side, per_side)
        dy = nearest_image(scene.escape, other["y"] + other["v"] * flight - y, side, per_side)
        dz = nearest_image(scene.escape, other["z"] + other["w"] * flight - z, side, per_side)
        end = max(side - reach, half * BEYOND)
        first = min(first, time_beyond(dx, other["u"] - path["u"], end))
        first = min(first, time_beyond(dy, other["v"] - path["v"], end))
        first = min(first, time_beyond(dz, other["w"] - path["w"], end))
    return now + first


@stage
def time_beyond(difference, velocity, end):  # type: ignore[no-untyped-def]
    """Time in s until a difference in m that is within ±`end` is there."""
    if velocity > 0.0:
        return (end - difference) / velocity
    return (end + difference) / -velocity if velocity < 0.0 else np.inf
