"""When does a particle hit another?  Roots of a quadratic, since motion is ballistic."""

import math

import numpy as np

from agglom_mpi.compilation import fused_stage, stage
from agglom_mpi.simulation.box import drawn_in, is_periodic, nearest_image
from agglom_mpi.simulation.event_cells import ALONG, GIANTS
from agglom_mpi.simulation.movers import RANGE
from agglom_mpi.simulation.tournament import set_time


@stage
def low_end(scene, low):  # type: ignore[no-untyped-def]
    """First cell of a range along an axis, cut off at a face that contacts do not cross."""
    return low if is_periodic(scene.escape) else max(low, 0)


@stage
def high_end(scene, along, high):  # type: ignore[no-untyped-def]
    """Last cell of a range along an axis, cut off at a face that contacts do not cross."""
    return high if is_periodic(scene.escape) else min(high, along - 1)


@stage
def gather_box(scene, cells, a0, a1, b0, b1, c0, c1):  # type: ignore[no-untyped-def]
    """Write the particles of the cells from (a0, b0, c0) to (a1, b1, c1) into `near`; how many.

    Without a branch per cell: most cells are empty or hold one, in no order a processor could
    foresee.
    """
    along = cells.shape[ALONG]
    near, head, following, place = cells.near, cells.head, cells.following, cells.place
    a0, a1 = low_end(scene, a0), high_end(scene, along, a1)
    b0, b1 = low_end(scene, b0), high_end(scene, along, b1)
    c0, c1 = low_end(scene, c0), high_end(scene, along, c1)
    count = 0
    for a in range(along + a0, along + a1 + 1):
        for b in range(along + b0, along + b1 + 1):
            row = place[0, a] + place[1, b]
            for c in range(along + c0, along + c1 + 1):
                j = head[row + place[2, c]]
                near[count] = j
                count += 1 if j >= 0 else 0
    k = 0
    while k < count:
        j = following[near[k]]
        near[count] = j
        count += 1 if j >= 0 else 0
        k += 1
    return count


@stage
def span_of_giant(scene, cells, coordinate, radius):  # type: ignore[no-untyped-def]
    """First and last cell along an axis where a giant may be touched before its range ends.

    Hits renew its range, so that it may be far outside a periodic box by now.
    """
    along = cells.shape[ALONG]
    coordinate = drawn_in(scene.escape, coordinate, scene.half_width)
    edge = 2.0 * scene.half_width / along
    reach = radius + 0.5 * edge + cells.range[0]
    low = math.floor((coordinate - reach + scene.half_width) / edge)
    high = math.floor((coordinate + reach + scene.half_width) / edge)
    if high - low + 1 >= along:
        return 0, along - 1
    return low, high


@stage
def gather(scene, cells, mover, x, y, z, turn):  # type: ignore[no-untyped-def]
    """Write whom a particle at (x, y, z) in m may hit into `near`; how many.

    `turn` is `RANGE` for everybody, or the face through which the particle came into its cell: then
    the nine cells that it had not beside it before, and the giants.
    """
    count = 0
    if mover["giant"] >= 0:
        if cells.shape[ALONG] > 0:
            a0, a1 = span_of_giant(scene, cells, x, mover["radius"])
            b0, b1 = span_of_giant(scene, cells, y, mover["radius"])
            c0, c1 = span_of_giant(scene, cells, z, mover["radius"])
            count = gather_box(scene, cells, a0, a1, b0, b1, c0, c1)
    else:
        a, b, c = np.int64(mover["a"]), np.int64(mover["b"]), np.int64(mover["c"])
        a0 = a + 1 if turn == 1 else a - 1
        a1 = a - 1 if turn == 0 else a + 1
        b0 = b + 1 if turn == 3 else b - 1
        b1 = b - 1 if turn == 2 else b + 1
        c0 = c + 1 if turn == 5 else c - 1
        c1 = c - 1 if turn == 4 else c + 1
        count = gather_box(scene, cells, a0, a1, b0, b1, c0, c1)
    for k in range(cells.shape[GIANTS]):
        cells.near[count + k] = cells.giants[k]
    return count + cells.shape[GIANTS]


@fused_stage
def first_hit(scene, movers, near, count, x, y, z, i, now, barred):  # type: ignore[no-untyped-def]
    """Earliest hit of particle i, at (x, y, z) in m now, among `count` others: when, with whom.

    Only hits that come before what the other has in mind count: otherwise the other turns to i
    again when that has happened. Overlapping and approaching is a hit now; receding is none.
    `barred` is who has just been hit.
    """
    mover = movers[i]
    side, per_side = 2.0 * scene.half_width, 0.5 / scene.half_width
    u, v, w, radius = mover["u"], mover["v"], mover["w"], mover["radius"]
    hit_time, partner = mover["hit_time"], -1
    for k in range(count):
        j = near[k]
        other = movers[j]
        flight = now - other["time"]
        dx = nearest_image(scene.escape, other["x"] + other["u"] * flight - x, side, per_side)
        dy = nearest_image(scene.escape, other["y"] + other["v"] * flight - y, side, per_side)
        dz = nearest_image(scene.escape, other["z"] + other["w"] * flight - z, side, per_side)
        du, dv, dw = other["u"] - u, other["v"] - v, other["w"] - w
        closing = dx * du + dy * dv + dz * dw
        reach = radius + other["radius"]
        excess = dx * dx + dy * dy + dz * dz - reach * reach
        square = du * du + dv * dv + dw * dw
        discriminant = closing * closing - square * excess
        if min(-closing, discriminant) > 0.0:
            time = now + max(0.0, excess) / (math.sqrt(discriminant) - closing)
            if time < hit_time and time < other["hit_time"] and j != barred:
                hit_time = time
                partner = j
    return hit_time, partner


@stage
def look(scene, cells, movers, tournament, i, now, turn, barred):  # type: ignore[no-untyped-def]
    """Find whether particle i hits something before what it has in mind, and tell whom it hits."""
    mover = movers[i]
    flight = now - mover["time"]
    x = mover["x"] + mover["u"] * flight
    y = mover["y"] + mover["v"] * flight
    z = mover["z"] + mover["w"] * flight
    near = cells.near
    count = gather(scene, cells, mover, x, y, z, turn)
    hit_time, partner = first_hit(scene, movers, near, count, x, y, z, i, now, barred)
    if partner >= 0:
        note(movers, i, partner, hit_time)
        note(movers, partner, i, hit_time)
        set_time(tournament, partner, min(hit_time, movers[partner]["turn_time"]))
    if is_periodic(scene.escape) and cells.shape[GIANTS] > 0:
        heed_images(scene, cells, movers, count, x, y, z, i, now)
    set_time(tournament, i, min(mover["hit_time"], mover["turn_time"]))


@stage
def note(movers, i, partner, hit_time):  # type: ignore[no-untyped-def]
    """Note that particle i hits `partner` at `hit_time` in s."""
    mover = movers[i]
    mover["hit_time"] = hit_time
    mover["partner"] = partner
    mover["hit_version"] = movers[partner]["version"]


@stage
def safe_reach(scene, cells):  # type: ignore[no-untyped-def]
    """Sum of two radii in m up to which the nearest image stays the only one until the next look.

    Both move by their range or by a cell at most; the next image is at least D away along an axis.
    """
    along = cells.shape[ALONG]
    edge = 2.0 * scene.half_width / along if along > 0 else cells.range[0]
    return scene.half_width - edge - cells.range[0]


@stage
def heed_images(scene, cells, movers, count, x, y, z, i, now):  # type: ignore[no-untyped-def]
    """Let particle i look around again before it may touch another image of somebody large."""
    mover = movers[i]
    if mover["radius"] + cells.largest[0] > safe_reach(scene, cells):
        time = first_image(scene, cells, movers, count, x, y, z, i, now)
        if time < mover["turn_time"]:
            mover["turn_time"] = time
            mover["turn"] = RANGE


@stage
def first_image(scene, cells, movers, count, x, y, z, i, now):  # type: ignore[no-untyped-def]
    """Time in s from which another image of someone too large to be safe may touch i."""
    side, half = 2.0 * scene.half_width, scene.half_width
    per_side = 1.0 / side
    mover = movers[i]
    safe = safe_reach(scene, cells)
    first = np.inf
    for k in range(count):
        other = movers[cells.near[k]]
        reach = mover["radius"] + other["radius"]
        if cells.near[k] == i or reach <= safe:
            continue
        flight = now - other["time"]
        dx = nearest_image(scene.escape, other["x"] + other["u"] * flight - x, side, per_side)
        dy = nearest_image(scene.escape, other["y"] + other["v"] * flight - y, side, per_side)
        dz = nearest_image(scene.escape, other["z"] + other["w"] * flight - z, side, per_side)
        end = max(side - reach, half * (1.0 + 1e-9))
        first = min(first, time_beyond(dx, other["u"] - mover["u"], end))
        first = min(first, time_beyond(dy, other["v"] - mover["v"], end))
        first = min(first, time_beyond(dz, other["w"] - mover["w"], end))
    return now + first


@stage
def time_beyond(difference, velocity, end):  # type: ignore[no-untyped-def]
    """Time in s until a difference in m that is within ±`end` is there."""
    if velocity > 0.0:
        return (end - difference) / velocity
    return (end + difference) / -velocity if velocity < 0.0 else np.inf
