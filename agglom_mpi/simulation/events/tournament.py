"""Who is next?  A tournament tree over one time per particle: the winner is the earliest.

Changing one time replays the matches on the way to the root, and ends where the outcome stands; a
particle that is not the winner of its neighbourhood needs two of them on average, whatever N is.
"""

from typing import NamedTuple

import numpy as np

from agglom_mpi.compilation import allocating, stage


class Tournament(NamedTuple):
    """Winner of each match, and its time.

    Node 1 is the root, the children of node n are 2n and 2n + 1, and node entries + i is entry i.

    Attributes
    ----------
    time
        Of the winner at each node in s, inf without an event, shape (2·entries,).
    winner
        Entry that wins at each node, shape (2·entries,), a power of two.
    """

    time: np.ndarray
    winner: np.ndarray


@allocating
def new_tournament(capacity: int) -> Tournament:
    """Return a tournament with room for `capacity` entries, all without an event."""
    entries = 2
    while entries < capacity:
        entries *= 2
    tournament = Tournament(np.full(2 * entries, np.inf), np.empty(2 * entries, np.uint32))
    for i in range(entries):
        tournament.winner[entries + i] = i
    for node in range(entries - 1, 0, -1):
        tournament.winner[node] = tournament.winner[2 * node]
    return tournament


@stage
def earliest(tournament: Tournament) -> np.int64:
    """Entry with the smallest time; the lowest of equals."""
    return np.int64(tournament.winner[1])


@stage
def earliest_time(tournament: Tournament) -> float:
    """Time of the earliest entry in s."""
    return tournament.time[1]


@stage
def set_time(tournament: Tournament, i: int, value: float) -> None:
    """Give entry i another time in s.

    The winner so far is carried along, and chosen without a branch: who wins cannot be foreseen.
    """
    time, winner = tournament.time, tournament.winner
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
