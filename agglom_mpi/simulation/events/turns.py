"""When does a particle leave its cell, its range or the box, and what then?"""

import numpy as np

from agglom_mpi.compilation import stage
from agglom_mpi.simulation.box import is_periodic
from agglom_mpi.simulation.events.cells import ALONG, link, unlink
from agglom_mpi.simulation.events.movers import RANGE, catch_up_position, void


@stage
def time_to_leave(coordinate, velocity, low, high):  # type: ignore[no-untyped-def]
    """Time in s until a coordinate in m leaves [low, high]."""
    if velocity > 0.0:
        return max(0.0, high - coordinate) / velocity
    return min(0.0, low - coordinate) / velocity if velocity < 0.0 else np.inf


@stage
def earlier_turn(path, plan, coordinate, velocity, low, high, face):  # type: ignore[no-untyped-def]
    """Take leaving [low, high] along an axis as the next turn, if it comes first."""
    time = path["time"] + time_to_leave(coordinate, velocity, low, high)
    if time < plan["turn_time"]:
        plan["turn_time"] = time
        plan["turn"] = face + (1 if velocity > 0.0 else 0) if face < RANGE else RANGE


@stage
def set_turn(scene, cells, movers, i):  # type: ignore[no-untyped-def]
    """Find when particle i leaves its cell, or a giant its range or a box with real faces.

    Without cells nothing ranges: in a periodic box the images say when to look again.
    """
    path, plan = movers.path[i], movers.plan[i]
    half = scene.half_width
    plan["turn_time"] = np.inf
    x, y, z = path["x"], path["y"], path["z"]
    u, v, w = path["u"], path["v"], path["w"]
    if plan["giant"] < 0:
        edge = 2.0 * half / cells.shape[ALONG]
        x0, y0, z0 = plan["a"] * edge - half, plan["b"] * edge - half, plan["c"] * edge - half
        earlier_turn(path, plan, x, u, x0, x0 + edge, 0)
        earlier_turn(path, plan, y, v, y0, y0 + edge, 2)
        earlier_turn(path, plan, z, w, z0, z0 + edge, 4)
        return
    if not is_periodic(scene.escape):
        earlier_turn(path, plan, x, u, -half, half, 0)
        earlier_turn(path, plan, y, v, -half, half, 2)
        earlier_turn(path, plan, z, w, -half, half, 4)
    if cells.shape[ALONG] > 0:
        reach = cells.range[0]
        earlier_turn(path, plan, x, u, x - reach, x + reach, RANGE)
        earlier_turn(path, plan, y, v, y - reach, y + reach, RANGE)
        earlier_turn(path, plan, z, w, z - reach, z + reach, RANGE)


@stage
def next_cell(index, face, along):  # type: ignore[no-untyped-def]
    """Index along its axis of the cell behind a face, and whether the box ended there."""
    if face & 1:
        return (0, 1) if index + 1 == along else (index + 1, 0)
    return (along - 1, -1) if index == 0 else (index - 1, 0)


@stage
def turn(scene, particles, cells, movers, i, now):  # type: ignore[no-untyped-def]
    """Let particle i take its turn at `now` in s; through which face the look around is due.

    A cell's face is where the nine cells behind it come into reach. After a jump to the opposite
    face of the box, or at the end of a range, everybody may be.
    """
    plan = movers.plan[i]
    face = np.int64(plan["turn"])
    if face == RANGE:
        catch_up_position(scene, particles, movers, i, now)
    else:
        beyond = 1 if face & 1 else -1
        if plan["giant"] < 0:
            unlink(cells, plan, i)
            beyond = step_cell(plan, face, cells.shape[ALONG])
            link(cells, plan, i)
        if beyond != 0:
            face = cross_face(scene, particles, movers, i, face, beyond, now)
    set_turn(scene, cells, movers, i)
    return face


@stage
def step_cell(plan, face, along):  # type: ignore[no-untyped-def]
    """Put a particle into the cell behind a face; ±1 if the box ended there, else 0."""
    if face < 2:
        plan["a"], beyond = next_cell(plan["a"], face, along)
    elif face < 4:
        plan["b"], beyond = next_cell(plan["b"], face, along)
    else:
        plan["c"], beyond = next_cell(plan["c"], face, along)
    return beyond


@stage
def cross_face(scene, particles, movers, i, face, beyond, now):  # type: ignore[no-untyped-def]
    """Take particle i across a face of the box; through which face the look around is due."""
    path, plan = movers.path[i], movers.plan[i]
    if is_periodic(scene.escape):
        shift = -2.0 * scene.half_width * beyond
        if face < 2:
            path["x"] += shift
        elif face < 4:
            path["y"] += shift
        else:
            path["z"] += shift
        return face
    catch_up_position(scene, particles, movers, i, now)
    opposite = -scene.half_width * beyond
    if face < 2:
        path["x"] = opposite
    elif face < 4:
        path["y"] = opposite
    else:
        path["z"] = opposite
    void(plan)
    return RANGE
