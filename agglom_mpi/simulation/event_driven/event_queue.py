"""The event queue: a tournament tree over one time per particle, whose root is the earliest.

Changing one time replays the matches on the way to the root, and ends where the outcome stands; a
particle that is not the winner of its neighbourhood needs two of them on average, whatever N is.
"""

from typing import NamedTuple

import numpy as np

from agglom_mpi.compilation.stages import inlined


class EventQueue(NamedTuple):
    """Tournament tree: the winner of each match, and its time.

    Node 1 is the root, the children of node n are 2n and 2n + 1, and node entries + i is entry i;
    `entries` is a power of two.

    Attributes
    ----------
    time
        Of the winner at each node in s, inf without an event, shape (2·entries,).
    winner
        Entry that wins at each node, shape (2·entries,).
    """

    time: np.ndarray
    winner: np.ndarray


def new_event_queue(capacity: int) -> EventQueue:
    """Return a queue with room for `capacity` entries, to be reset."""
    entries = 2
    while entries < capacity:
        entries *= 2
    return EventQueue(np.empty(2 * entries), np.empty(2 * entries, np.uint32))


@inlined
def reset_event_queue(event_queue: EventQueue) -> None:
    """Leave all entries without an event."""
    entries = event_queue.winner.size // 2
    for i in range(entries):
        event_queue.winner[entries + i] = i
        event_queue.time[entries + i] = np.inf
    for node in range(entries - 1, 0, -1):
        event_queue.winner[node] = event_queue.winner[2 * node]
        event_queue.time[node] = np.inf


@inlined
def earliest(event_queue: EventQueue) -> np.int64:
    """Entry with the smallest time; the lowest of equals."""
    return np.int64(event_queue.winner[1])


@inlined
def earliest_time(event_queue: EventQueue) -> float:
    """Time of the earliest entry in s."""
    return event_queue.time[1]


@inlined
def set_time(event_queue: EventQueue, i: int, value: float) -> None:
    """Give entry i another time in s.

    The winner so far is carried along, and chosen without a branch: who wins cannot be foreseen.
    """
    time, winner = event_queue.time, event_queue.winner
    one = np.uint64(1)
    best = np.int64(i)
    node = np.uint64(winner.size // 2 + i)
    time[node] = value
    while node > one:
        rival = node ^ one
        lost = np.int64((time[rival] < value) | ((time[rival] == value) & (rival < node)))
        best += lost * (np.int64(winner[rival]) - best)
        value = min(time[rival], value)
        node >>= one
        if np.int64(winner[node]) == best and best != i:
            break
        winner[node] = best
        time[node] = value
