"""Prediction of collisions: neighbours of a particle, periodic images, roots of a quadratic."""

import math
from typing import Final

import numpy as np

from agglom_mpi.kernels import inlined, inlined_fma
from agglom_mpi.simulation.boundary import is_periodic, nearest_image
from agglom_mpi.simulation.event_driven.cells import ALONG, OVERSIZE
from agglom_mpi.simulation.event_driven.event_queue import set_time
from agglom_mpi.simulation.event_driven.flights import RANGE


@inlined
def low_end(scene, low):
    """First cell of a range along an axis, cut off at a face that contacts do not cross."""
    return low if is_periodic(scene.escape) else max(low, 0)


@inlined
def high_end(scene, along, high):
    """Last cell of a range along an axis, cut off at a face that contacts do not cross."""
    return high if is_periodic(scene.escape) else min(high, along - 1)


@inlined
def gather_box(scene, cells, a0, a1, b0, b1, c0, c1):
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


@inlined
def span_of_oversize(scene, cells, coordinate, radius):
    """First and last cell along an axis where an oversize particle may be touched in its range."""
    along = cells.shape[ALONG]
    edge = 2.0 * scene.half_width / along
    reach = radius + 0.5 * edge + cells.range[0]
    low = math.floor((coordinate - reach + scene.half_width) / edge)
    high = math.floor((coordinate + reach + scene.half_width) / edge)
    if high - low + 1 >= along:
        return 0, along - 1
    return low, high


@inlined
def neighbours_of(scene, cells, trajectory, next_event, x, y, z, face):
    """Write whom a particle at (x, y, z) in m may hit into `near`; how many.

    `face` is `RANGE` for everybody, or the face through which the particle came into its cell: then
    the nine cells that it had not beside it before, and the oversize ones.
    """
    count = 0
    if next_event["oversize"] >= 0:
        if cells.shape[ALONG] > 0:
            a0, a1 = span_of_oversize(scene, cells, x, trajectory["radius"])
            b0, b1 = span_of_oversize(scene, cells, y, trajectory["radius"])
            c0, c1 = span_of_oversize(scene, cells, z, trajectory["radius"])
            count = gather_box(scene, cells, a0, a1, b0, b1, c0, c1)
    else:
        a, b, c = np.int64(next_event["a"]), np.int64(next_event["b"]), np.int64(next_event["c"])
        a0 = a + 1 if face == 1 else a - 1
        a1 = a - 1 if face == 0 else a + 1
        b0 = b + 1 if face == 3 else b - 1
        b1 = b - 1 if face == 2 else b + 1
        c0 = c + 1 if face == 5 else c - 1
        c1 = c - 1 if face == 4 else c + 1
        count = gather_box(scene, cells, a0, a1, b0, b1, c0, c1)
    for k in range(cells.shape[OVERSIZE]):
        cells.near[count + k] = cells.oversize[k]
    return count + cells.shape[OVERSIZE]


BEYOND: Final = 1.0 + 1e-9
"""Share of D at which the nearest image is another one for certain, so that a look finds it."""


@inlined
def safe_reach(scene, cells):
    """Sum of two radii in m up to which the nearest image stays the only one until the next look.

    Without cells none is safe: nobody looks again before an image says so.

    One moves by its range, the other by its range or a cell at most; the next image is at least D
    away along an axis.
    """
    along = cells.shape[ALONG]
    if along == 0:
        return -np.inf
    return scene.half_width - 2.0 * scene.half_width / along - cells.range[0]


@inlined
def limit_to_nearest_image(scene, cells, flights, count, x, y, z, i, now):
    """Let particle i look around again before it may touch another image of somebody large."""
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    if trajectory["radius"] + cells.largest[0] > safe_reach(scene, cells):
        time = first_image(scene, cells, flights, count, x, y, z, i, now)
        if time < next_event["turn_time"]:
            next_event["turn_time"] = time
            next_event["turn"] = RANGE


@inlined
def first_image(scene, cells, flights, count, x, y, z, i, now):
    """Time in s from which another image of someone too large to be safe may touch i."""
    side, half = 2.0 * scene.half_width, scene.half_width
    per_side = 1.0 / side
    trajectory = flights.trajectory[i]
    safe = safe_reach(scene, cells)
    first = np.inf
    for k in range(count):
        other = flights.trajectory[cells.near[k]]
        reach = trajectory["radius"] + other["radius"]
        if cells.near[k] == i or reach <= safe:
            continue
        flight = now - other["time"]
        dx = nearest_image(scene.escape, other["x"] + other["u"] * flight - x, side, per_side)
        dy = nearest_image(scene.escape, other["y"] + other["v"] * flight - y, side, per_side)
        dz = nearest_image(scene.escape, other["z"] + other["w"] * flight - z, side, per_side)
        end = max(side - reach, half * BEYOND)
        first = min(first, time_beyond(dx, other["u"] - trajectory["u"], end))
        first = min(first, time_beyond(dy, other["v"] - trajectory["v"], end))
        first = min(first, time_beyond(dz, other["w"] - trajectory["w"], end))
    return now + first


@inlined
def time_beyond(difference, velocity, end):
    """Time in s until a difference in m that is within ±`end` is there."""
    if velocity > 0.0:
        return (end - difference) / velocity
    return (end + difference) / -velocity if velocity < 0.0 else np.inf


SLACK: Final = 1e-9
"""Share of b² by which b² − ac may be negative from rounding, for whom c is not far above b²/a."""

RESOLUTION: Final = 2.0**-51
"""Approach over speed up to which an impact may leave both velocities as they are, by rounding."""


@inlined_fma
def squared_cross(dx, dy, dz, du, dv, dw):
    """Square of the cross product of two vectors."""
    return (dy * dw - dz * dv) ** 2 + (dz * du - dx * dw) ** 2 + (dx * dv - dy * du) ** 2


@inlined
def is_resolved(trajectory, other, dx, dy, dz, closing):
    """Whether two approach by more than the rounding of their velocities.

    If not, an impact changes nothing: three that overlap would have such impacts for ever.
    """
    speeds = abs(trajectory["u"]) + abs(trajectory["v"]) + abs(trajectory["w"])
    speeds += abs(other["u"]) + abs(other["v"]) + abs(other["w"])
    return -closing > RESOLUTION * speeds * (abs(dx) + abs(dy) + abs(dz))


@inlined_fma
def first_hit(scene, flights, near, count, x, y, z, i, now, barred):
    """Earliest hit of particle i, at (x, y, z) in m now, among `count` others: when, with whom.

    Only hits that come before what the other has in mind count: otherwise the other turns to i
    again when that has happened. Overlapping and approaching is a hit now, if it can be told from
    rounding; receding is none. Of hits at the same time, that of the lowest slot is taken.
    `barred` is who has just been hit. A first test that rounding may fail is cheap; who passes it
    is judged by the distance at which the two would pass each other, which loses fewer digits.
    """
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    side, per_side = 2.0 * scene.half_width, 0.5 / scene.half_width
    u, v, w, radius = trajectory["u"], trajectory["v"], trajectory["w"], trajectory["radius"]
    hit_time, partner = next_event["hit_time"], -1
    for k in range(count):
        j = near[k]
        other = flights.trajectory[j]
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
            first = first and time < flights.next_event[j]["hit_time"] and j != barred
            real = time > now or is_resolved(trajectory, other, dx, dy, dz, closing)
            if first and discriminant > 0.0 and real:
                hit_time = time
                partner = np.int64(j)
    return hit_time, partner


@inlined
def predict_collision(scene, cells, flights, event_queue, i, now, face, barred):
    """Find whether particle i hits something before what it has in mind, and tell whom it hits."""
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    flight = now - trajectory["time"]
    x = trajectory["x"] + trajectory["u"] * flight
    y = trajectory["y"] + trajectory["v"] * flight
    z = trajectory["z"] + trajectory["w"] * flight
    near = cells.near
    count = neighbours_of(scene, cells, trajectory, next_event, x, y, z, face)
    hit_time, partner = first_hit(scene, flights, near, count, x, y, z, i, now, barred)
    if partner >= 0:
        note(flights, i, partner, hit_time)
        note(flights, partner, i, hit_time)
        set_time(event_queue, partner, min(hit_time, flights.next_event[partner]["turn_time"]))
    if is_periodic(scene.escape) and cells.shape[OVERSIZE] > 0:
        limit_to_nearest_image(scene, cells, flights, count, x, y, z, i, now)
    set_time(event_queue, i, min(next_event["hit_time"], next_event["turn_time"]))


@inlined
def note(flights, i, partner, hit_time):
    """Note that particle i hits `partner` at `hit_time` in s."""
    next_event = flights.next_event[i]
    next_event["hit_time"] = hit_time
    next_event["partner"] = partner
    next_event["hit_version"] = flights.next_event[partner]["version"]
