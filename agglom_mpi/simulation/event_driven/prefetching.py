"""What the next events read is read into the caches before their turn.

Among many particles that of the next event, and all around it, may lie anywhere in memory. The
upper matches of the event queue tell whose turn comes soon. When a particle becomes one of their
winners, what is read for it in its turn is prefetched in three steps, of which each needs what the
one before has read: its records, some 256 events before; the cells around it and the records of its
partner, 64; and the trajectories of those in the cells, 16.

Results do not depend on it.
"""

from typing import Final

import numpy as np

from agglom_mpi.compilation.kernels import prefetch
from agglom_mpi.compilation.stages import inlined, not_inlined
from agglom_mpi.simulation.event_driven.cells import PER_AXIS
from agglom_mpi.simulation.event_driven.prediction import cells_beside, first_cell, last_cell

RECORDS: Final = 256
SURROUNDINGS: Final = 64
TRAJECTORIES: Final = 16
"""Matches of the queue whose winners have their records prefetched, and so on; these are the nodes
from that number to twice as many."""

MATCHES: Final = 10
"""Matches of a particle's way through the queue that are prefetched; most changes end before."""

PREFETCH_ABOVE: Final = 50_000
"""Particles of a scene above which prefetching pays; fewer are in the caches anyway."""


def new_winners(count: int) -> np.ndarray | None:
    """Return room for known winners, by node; None where `count` particles do without."""
    return np.zeros(2 * RECORDS, np.uint32) if count > PREFETCH_ABOVE else None


@inlined
def prefetch_events(scene, particles, events, winners, due):
    """Prefetch what the events of those read that became winners by those of the `due` first.

    Nothing where the scene has no room for winners, and where cells are too few for two on to be
    another one. `winners` are those of the events, an argument so that all this is left out of the
    kernel where there are none.
    """
    if winners is not None and events.cells.shape[PER_AXIS] > 2:
        prefetch_for_winners(scene, particles, events, winners, due)


@not_inlined
def prefetch_for_winners(scene, particles, events, winners, due):
    """Look at three matches above each particle that is due, and prefetch for new winners."""
    queue, flights = events.event_queue, events.flights
    for k in range(due):
        node = match_above(queue.winner.size // 2 + events.due[k], RECORDS)
        if is_new_winner(queue, winners, node):
            prefetch(flights.trajectory, queue.winner[node])
            prefetch(flights.next_event, queue.winner[node])
        node = match_above(node, SURROUNDINGS)
        if is_new_winner(queue, winners, node):
            prefetch_surroundings(scene, particles, events, queue.winner[node])
        node = match_above(node, TRAJECTORIES)
        if is_new_winner(queue, winners, node):
            prefetch_trajectories(scene, events, queue.winner[node])


@inlined
def match_above(node, matches):
    """Return the match above a node that is one of `matches` side by side."""
    while node >= 2 * matches:
        node //= 2
    return node


@inlined
def is_new_winner(queue, winners, node):
    """Whether another particle wins a match than when this was asked before; without event: no."""
    if queue.winner[node] == winners[node] or queue.time[node] == np.inf:
        return False
    winners[node] = queue.winner[node]
    return True


@inlined
def prefetch_surroundings(scene, particles, events, i):
    """Prefetch the cells around particle i, its place in the queue, and its partner."""
    flights, cells = events.flights, events.cells
    next_event = flights.next_event[i]
    partner = next_event["partner"]
    prefetch_matches(events.event_queue, i)
    if next_event["crossing_time"] <= next_event["collision_time"]:
        prefetch(cells.previous_in_cell, i)
        prefetch(cells.next_in_cell, i)
    elif partner >= 0:
        prefetch(flights.trajectory, partner)
        prefetch(flights.next_event, partner)
        prefetch_matches(events.event_queue, partner)
        prefetch_record(particles.records, i)
        prefetch_record(particles.records, partner)
    offset, per_axis = cells.offset, cells.shape[PER_AXIS]
    a0, a1, b0, b1, c0, c1 = cells_of_event(scene, cells, next_event)
    for a in range(per_axis + a0, per_axis + a1 + 1):
        for b in range(per_axis + b0, per_axis + b1 + 1):
            row = offset[0, a] + offset[1, b]
            prefetch(cells.head, row + offset[2, per_axis + c0])
            prefetch(cells.head, row + offset[2, per_axis + c1])


@inlined
def prefetch_trajectories(scene, events, i):
    """Prefetch the first particle in each of the cells around particle i; few hold more."""
    flights, cells = events.flights, events.cells
    offset, per_axis = cells.offset, cells.shape[PER_AXIS]
    a0, a1, b0, b1, c0, c1 = cells_of_event(scene, cells, flights.next_event[i])
    for a in range(per_axis + a0, per_axis + a1 + 1):
        for b in range(per_axis + b0, per_axis + b1 + 1):
            row = offset[0, a] + offset[1, b]
            for c in range(per_axis + c0, per_axis + c1 + 1):
                j = cells.head[row + offset[2, c]]
                if j >= 0:
                    prefetch(flights.trajectory, j)
                    prefetch(cells.next_in_cell, j)


@inlined
def cells_of_event(scene, cells, next_event):
    """First and last cell along each axis that are looked at after the next event of a particle.

    After a crossing these are the nine behind its next cell; of an oversize particle, none.
    """
    per_axis = cells.shape[PER_AXIS]
    face = np.int64(next_event["crossing"])
    if next_event["crossing_time"] > next_event["collision_time"]:
        face = -1
    a0, a1 = cells_behind(np.int64(next_event["a"]), face)
    b0, b1 = cells_behind(np.int64(next_event["b"]), face - 2)
    c0, c1 = cells_behind(np.int64(next_event["c"]), face - 4)
    if next_event["oversize"] >= 0:
        a0, a1 = 1, 0
    return (
        first_cell(scene, a0),
        last_cell(scene, per_axis, a1),
        first_cell(scene, b0),
        last_cell(scene, per_axis, b1),
        first_cell(scene, c0),
        last_cell(scene, per_axis, c1),
    )


@inlined
def cells_behind(index, face):
    """First and last cell beside `index`, or the one behind the next if it is left by face 0, 1."""
    entered = index
    if face == 0:
        entered -= 1
    elif face == 1:
        entered += 1
    return cells_beside(entered, face)


@inlined
def prefetch_record(records, i):
    """Prefetch a record that may begin in one cache line and end in the next."""
    prefetch(records, i)
    prefetch(records, i + 1)


@inlined
def prefetch_matches(event_queue, i):
    """Prefetch the first matches of entry i on its way to the root."""
    node = event_queue.winner.size // 2 + i
    for _ in range(MATCHES):
        prefetch(event_queue.time, node)
        prefetch(event_queue.winner, node)
        node //= 2
