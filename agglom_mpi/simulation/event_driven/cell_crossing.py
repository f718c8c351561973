"""Cell crossings: when a particle leaves its cell, its range or the box, and what follows."""

import numpy as np

from agglom_mpi.compilation.stages import inlined
from agglom_mpi.simulation.boundary import cell_of, is_periodic, is_sheared
from agglom_mpi.simulation.event_driven.cells import PER_AXIS, copy_if_oversize, link, unlink
from agglom_mpi.simulation.event_driven.flights import (
    RANGE,
    copy_motion,
    invalidate_prediction,
    synchronise_particle,
)
from agglom_mpi.simulation.shear import shift_image


@inlined
def time_to_leave(coordinate, velocity, low, high):
    """Time in s until a coordinate in m leaves [low, high]; inf or nan at rest."""
    way = high - coordinate if velocity > 0.0 else coordinate - low
    return max(0.0, way) / abs(velocity)


@inlined
def earlier_crossing(known, trajectory, coordinate, velocity, low, high, face):
    """Return the earlier of a known crossing, time in s and face, and leaving [low, high].

    `face` is that at `low`, or `RANGE`. Without a branch: directions cannot be foreseen.
    """
    time = trajectory["time"] + time_to_leave(coordinate, velocity, low, high)
    reached = face + np.int64(velocity > 0.0) if face < RANGE else RANGE
    sooner = time < known[0]
    return time if sooner else known[0], reached if sooner else known[1]


@inlined
def schedule_crossing(scene, cells, flights, i):
    """Find when particle i leaves its cell or, if oversize, its range or a box with real faces.

    Without a range the prediction says when to predict again.
    """
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    half = scene.half_width
    x, y, z = trajectory["x"], trajectory["y"], trajectory["z"]
    u, v, w = trajectory["u"], trajectory["v"], trajectory["w"]
    known = np.inf, RANGE
    if next_event["oversize"] < 0:
        edge = 2.0 * half / cells.shape[PER_AXIS]
        x0, y0, z0 = (
            next_event["a"] * edge - half,
            next_event["b"] * edge - half,
            next_event["c"] * edge - half,
        )
        known = earlier_crossing(known, trajectory, x, u, x0, x0 + edge, 0)
        known = earlier_crossing(known, trajectory, y, v, y0, y0 + edge, 2)
        known = earlier_crossing(known, trajectory, z, w, z0, z0 + edge, 4)
    else:
        if not is_periodic(scene.escape):
            known = earlier_crossing(known, trajectory, x, u, -half, half, 0)
            known = earlier_crossing(known, trajectory, y, v, -half, half, 2)
            known = earlier_crossing(known, trajectory, z, w, -half, half, 4)
        reach = cells.range[0]
        if reach < np.inf:
            known = earlier_crossing(known, trajectory, x, u, x - reach, x + reach, RANGE)
            known = earlier_crossing(known, trajectory, y, v, y - reach, y + reach, RANGE)
            known = earlier_crossing(known, trajectory, z, w, z - reach, z + reach, RANGE)
    next_event["crossing_time"], next_event["crossing"] = known


@inlined
def next_cell(index, face, per_axis):
    """Index along its axis of the cell behind a face, and ±1 if that is across the box, else 0."""
    if face & 1:
        return (0, 1) if index + 1 == per_axis else (index + 1, 0)
    return (per_axis - 1, -1) if index == 0 else (index - 1, 0)


@inlined
def cross_cell(scene, particles, ledger, cells, flights, i, now):
    """Process the crossing of particle i at `now` in s; return the face to predict through.

    Through a cell's face the nine cells behind it come into reach. After a jump to the opposite
    face of the box, or at the end of a range, everything may be in reach: `RANGE`.
    """
    next_event = flights.next_event[i]
    face = np.int64(next_event["crossing"])
    if face == RANGE:
        synchronise_particle(scene, particles, ledger, flights, i, now)
        copy_if_oversize(cells, flights, i)
    else:
        beyond = 1 if face & 1 else -1
        if next_event["oversize"] < 0:
            unlink(cells, next_event, i)
            beyond = step_cell(next_event, face, cells.shape[PER_AXIS])
            link(cells, next_event, i)
        if beyond != 0:
            if is_sheared(scene.escape) and (face == 2 or face == 3):
                face = cross_sheared_face(scene, particles, ledger, cells, flights, i, beyond, now)
            else:
                face = cross_face(scene, particles, ledger, flights, i, face, beyond, now)
            copy_if_oversize(cells, flights, i)
    return face


@inlined
def step_cell(next_event, face, per_axis):
    """Put a particle into the cell behind a face; ±1 if that is across the box, else 0."""
    if face < 2:
        next_event["a"], beyond = next_cell(next_event["a"], face, per_axis)
    elif face < 4:
        next_event["b"], beyond = next_cell(next_event["b"], face, per_axis)
    else:
        next_event["c"], beyond = next_cell(next_event["c"], face, per_axis)
    return beyond


@inlined
def cross_face(scene, particles, ledger, flights, i, face, beyond, now):
    """Take particle i across a face of the box; return the face to predict through."""
    trajectory, next_event = flights.trajectory[i], flights.next_event[i]
    if is_periodic(scene.escape):
        shift = -2.0 * scene.half_width * beyond
        if face < 2:
            trajectory["x"] += shift
        elif face < 4:
            trajectory["y"] += shift
        else:
            trajectory["z"] += shift
        return face
    synchronise_particle(scene, particles, ledger, flights, i, now)
    opposite = -scene.half_width * beyond
    if face < 2:
        trajectory["x"] = opposite
    elif face < 4:
        trajectory["y"] = opposite
    else:
        trajectory["z"] = opposite
    invalidate_prediction(next_event)
    return RANGE


@inlined
def cross_sheared_face(scene, particles, ledger, cells, flights, i, beyond, now):
    """Take particle i, in a cell, across a face of y of a sheared box, as its image in the box.

    It flies on as before, so what was predicted holds; but all around it may be in reach.
    """
    particle, next_event = particles.records[i], flights.next_event[i]
    synchronise_particle(scene, particles, ledger, flights, i, now)
    shift_image(scene, particle, ledger, -beyond, now)
    copy_motion(flights.trajectory[i], particle)
    unlink(cells, next_event, i)
    next_event["a"] = cell_of(particle["x"], cells.shape[PER_AXIS], scene.half_width)
    link(cells, next_event, i)
    return RANGE
