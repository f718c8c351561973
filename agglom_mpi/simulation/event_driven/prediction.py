"""Prediction of collisions: neighbours of a particle, periodic images, roots of a quadratic."""

import math
from typing import Final

import numpy as np

from agglom_mpi.compilation.kernels import fused
from agglom_mpi.compilation.stages import inlined
from agglom_mpi.simulation.boundary import flow_speed, image_offset, is_periodic, is_sheared
from agglom_mpi.simulation.event_driven.cells import OVERSIZE, PER_AXIS, SHIFTS
from agglom_mpi.simulation.event_driven.comparison import (
    compare,
    gather_flights,
    highest_rate,
    images_above,
    keep_likely,
    scalar_product,
    way_after,
)
from agglom_mpi.simulation.event_driven.event_queue import set_time
from agglom_mpi.simulation.event_driven.flights import RANGE
from agglom_mpi.simulation.shear import columns_beside, plus_images


@inlined
def first_cell(scene, low):
    """First cell of a range along an axis, cut off at a face that contacts do not cross."""
    return low if is_periodic(scene.escape) else max(low, 0)


@inlined
def last_cell(scene, per_axis, high):
    """Last cell of a range along an axis, cut off at a face that contacts do not cross."""
    return high if is_periodic(scene.escape) else min(high, per_axis - 1)


@inlined
def particles_in_cells(scene, cells, a0, a1, b0, b1, c0, c1, count):
    """Write the particles of cells (a0, b0, c0) to (a1, b1, c1) behind `count` candidates.

    Returns how many there are then. Without a branch per cell: most cells are empty or hold one, in
    no order a processor could foresee.
    """
    per_axis = cells.shape[PER_AXIS]
    candidates, head, next_in_cell, offset = (
        cells.candidates,
        cells.head,
        cells.next_in_cell,
        cells.offset,
    )
    a0, a1 = first_cell(scene, a0), last_cell(scene, per_axis, a1)
    b0, b1 = first_cell(scene, b0), last_cell(scene, per_axis, b1)
    c0, c1 = first_cell(scene, c0), last_cell(scene, per_axis, c1)
    k = count
    for a in range(per_axis + a0, per_axis + a1 + 1):
        for b in range(per_axis + b0, per_axis + b1 + 1):
            row = offset[0, a] + offset[1, b]
            for c in range(per_axis + c0, per_axis + c1 + 1):
                j = head[row + offset[2, c]]
                candidates[count] = j
                count += 1 if j >= 0 else 0
    while k < count:
        j = next_in_cell[candidates[k]]
        candidates[count] = j
        count += 1 if j >= 0 else 0
        k += 1
    return count


@inlined
def particles_around(scene, cells, a0, a1, b0, b1, c0, c1):
    """Write the particles of these cells into `candidates`, in shear row by row; their number."""
    if not is_sheared(scene.escape):
        return particles_in_cells(scene, cells, a0, a1, b0, b1, c0, c1, 0)
    count, per_axis = 0, cells.shape[PER_AXIS]
    if b1 - b0 + 1 >= per_axis:
        a0, a1 = 0, per_axis - 1
    shifts = cells.shape[SHIFTS]
    for b in range(b0, b1 + 1):
        first, last = columns_beside(scene.escape, b, a0, a1, per_axis, shifts)
        count = particles_in_cells(scene, cells, first, last, b, b, c0, c1, count)
    return count


@inlined
def cells_of_oversize(scene, cells, coordinate, radius):
    """First and last cell along an axis where an oversize particle may be touched in its range."""
    per_axis = cells.shape[PER_AXIS]
    edge = 2.0 * scene.half_width / per_axis
    reach = radius + 0.5 * edge + cells.range[0]
    low = math.floor((coordinate - reach + scene.half_width) / edge)
    high = math.floor((coordinate + reach + scene.half_width) / edge)
    if high - low + 1 >= per_axis:
        return 0, per_axis - 1
    return low, high


@inlined
def cells_beside(index, face):
    """First and last cell beside `index` along an axis, or the one behind, if entered by a face.

    Along this axis the face is 0 or 1.
    """
    first = index + 1 if face == 1 else index - 1
    last = index - 1 if face == 0 else index + 1
    return first, last


@inlined
def neighbours_of(scene, cells, trajectory, next_event, x, y, z, face):
    """Write the particles in cells around (x, y, z) in m into `candidates`; return their number.

    `face` is `RANGE` for all, or the face through which the particle came into its cell: then the
    nine cells that were not beside it before.
    """
    count = 0
    if next_event["oversize"] >= 0:
        if cells.shape[PER_AXIS] > 0:
            a0, a1 = cells_of_oversize(scene, cells, x, trajectory["radius"])
            b0, b1 = cells_of_oversize(scene, cells, y, trajectory["radius"])
            c0, c1 = cells_of_oversize(scene, cells, z, trajectory["radius"])
            count = particles_around(scene, cells, a0, a1, b0, b1, c0, c1)
    else:
        a, b, c = np.int64(next_event["a"]), np.int64(next_event["b"]), np.int64(next_event["c"])
        a0, a1 = cells_beside(a, face)
        b0, b1 = cells_beside(b, face - 2)
        c0, c1 = cells_beside(c, face - 4)
        count = particles_around(scene, cells, a0, a1, b0, b1, c0, c1)
    return count


@inlined
def safe_reach(scene, cells):
    """Sum of two radii in m up to which only nearest images can touch until the next prediction.

    One moves by its range, the other by its range or a cell at most; the next image is at least D
    away along an axis. Without a range none is safe, nor in shear, where images move, too. Without
    oversize particles all are, as with faces that contacts do not cross.
    """
    if not is_periodic(scene.escape) or cells.shape[OVERSIZE] == 0:
        return np.inf
    if is_sheared(scene.escape):
        return 0.0
    per_axis = cells.shape[PER_AXIS]
    if per_axis == 0:
        return scene.half_width - 2.0 * cells.range[0]
    return scene.half_width - 2.0 * scene.half_width / per_axis - cells.range[0]


VELOCITY_RESOLUTION: Final = 2.0**-51
"""Approach over speed up to which an impact may leave both velocities as they are, by rounding."""


@inlined
def squared_cross(dx, dy, dz, du, dv, dw):
    """Square of the cross product of two vectors."""
    a = fused(dy, dw, -dz * dv)
    b = fused(dz, du, -dx * dw)
    c = fused(dx, dv, -dy * du)
    return scalar_product(a, b, c, a, b, c)


@inlined
def is_resolved(trajectory, other, dx, dy, dz, closing):
    """Whether two approach by more than the rounding of their velocities.

    If not, an impact changes nothing: three that overlap would have such impacts for ever.
    """
    speeds = abs(trajectory["u"]) + abs(trajectory["v"]) + abs(trajectory["w"])
    speeds += abs(other["u"]) + abs(other["v"]) + abs(other["w"])
    return -closing > VELOCITY_RESOLUTION * speeds * (abs(dx) + abs(dy) + abs(dz))


@inlined
def first_collision(scene, cells, flights, count, x, y, z, i, now, excluded):
    """Earliest collision of particle i, now at (x, y, z) in m, with candidates: time in s, partner.

    Only collisions before the candidate's own next one count: otherwise the candidate predicts
    with i again when that has happened. Overlapping and approaching is a collision now, if it can
    be told from rounding; receding is none. Of collisions at the same time, that with the lowest
    slot is taken. `excluded` is the particle that i has just collided with. The distance at which
    two would pass each other decides, which loses fewer digits than the test before.
    """
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    side, per_side = 2.0 * scene.half_width, 0.5 / scene.half_width
    ahead, faster = image_offset(scene.escape, side, now), flow_speed(scene.escape, side)
    collision_time, partner = next_event["collision_time"], -1
    for k in range(count):
        if cells.likely_times[k] > collision_time - now:
            continue
        j = cells.candidates[k]
        other = flights.trajectory[j]
        flight = now - other["time"]
        images = images_above(scene, other["y"], other["v"], flight, y, per_side)
        origin = plus_images(scene.escape, x, images, ahead)
        dx = way_after(scene, other["x"], other["u"], flight, origin, side, per_side)
        dy = way_after(scene, other["y"], other["v"], flight, y, side, per_side)
        dz = way_after(scene, other["z"], other["w"], flight, z, side, per_side)
        du = plus_images(scene.escape, other["u"] - trajectory["u"], images, -faster)
        dv = other["v"] - trajectory["v"]
        dw = other["w"] - trajectory["w"]
        closing = scalar_product(dx, dy, dz, du, dv, dw)
        reach = trajectory["radius"] + other["radius"]
        excess = fused(-reach, reach, scalar_product(dx, dy, dz, dx, dy, dz))
        square = scalar_product(du, dv, dw, du, dv, dw)
        discriminant = fused(square * reach, reach, -squared_cross(dx, dy, dz, du, dv, dw))
        # The earlier root of |dr + dv t| = reach, in the form in which nothing cancels.
        time = now + max(0.0, excess) / (math.sqrt(max(0.0, discriminant)) - closing)
        first = time < collision_time or (time == collision_time and j < partner)
        first = first and time < flights.next_event[j]["collision_time"] and j != excluded
        real = time > now or is_resolved(trajectory, other, dx, dy, dz, closing)
        if first and discriminant > 0.0 and real:
            collision_time = time
            partner = np.int64(j)
    return collision_time, partner


@inlined
def predict_collision(scene, cells, flights, event_queue, i, now, face, excluded):
    """Predict the next collision of particle i, and enter it for both partners."""
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    flight = now - trajectory["time"]
    x = trajectory["x"] + trajectory["u"] * flight
    y = trajectory["y"] + trajectory["v"] * flight
    z = trajectory["z"] + trajectory["w"] * flight
    count = neighbours_of(scene, cells, trajectory, next_event, x, y, z, face)
    count = gather_flights(cells, flights, count)
    image_rate, safe = 0.0, safe_reach(scene, cells)
    if trajectory["radius"] + cells.largest[0] > safe:
        compare(scene, cells, count, trajectory, x, y, z, now, safe)
        image_rate = highest_rate(cells, count)
    else:
        compare(scene, cells, count, trajectory, x, y, z, now, None)
    count = keep_likely(cells, count, next_event["collision_time"] - now)
    collision_time, partner = first_collision(
        scene, cells, flights, count, x, y, z, i, now, excluded
    )
    if partner >= 0:
        set_prediction(flights, i, partner, collision_time)
        set_prediction(flights, partner, i, collision_time)
        set_time(
            event_queue, partner, min(collision_time, flights.next_event[partner]["crossing_time"])
        )
    if image_rate > 0.0 and now + 1.0 / image_rate < next_event["crossing_time"]:
        next_event["crossing_time"] = now + 1.0 / image_rate
        next_event["crossing"] = RANGE
    set_time(event_queue, i, min(next_event["collision_time"], next_event["crossing_time"]))


@inlined
def set_prediction(flights, i, partner, collision_time):
    """Enter the collision of particle i with `partner` at `collision_time` in s."""
    next_event = flights.next_event[i]
    next_event["collision_time"] = collision_time
    next_event["partner"] = partner
    next_event["partner_version"] = flights.next_event[partner]["version"]
