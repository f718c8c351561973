"""Who is next?  A tournament tree over one time per particle: the winner is the earliest.

Changing one time replays the matches on the way to the root, and ends where the outcome stands; a
particle that is not the winner of its neighbourhood needs two of them on average, whatever N is.
"""

from typing import NamedTuple

import numpy as np

from agglom_mpi.compilation import allocating, stage


class Tournament(NamedTuple):
    """Time of each entry, and the winner of each match.

    Attributes
    ----------
    key
        Times in s, inf for entries without an event, shape (entries,), a power of two.
    winner
        Entry that wins at each node; node 1 is the root, the children of n are 2n and 2n + 1, and
        node entries + i is entry i itself; shape (2·entries,).
    """

    key: np.ndarray
    winner: np.ndarray


@allocating
def new_tournament(capacity: int) -> Tournament:
    """Return a tournament with room for `capacity` entries, all without an event."""
    entries = 2
    while entries < capacity:
        entries *= 2
    tournament = Tournament(np.full(entries, np.inf), np.empty(2 * entries, np.uint32))
    for i in range(entries):
        tournament.winner[entries + i] = i
    for node in range(entries - 1, 0, -1):
        tournament.winner[node] = tournament.winner[2 * node]
    return tournament


@stage
def earliest(tournament: Tournament) -> int:
    """Entry with the smallest time; the lowest of equals."""
    return np.int64(tournament.winner[1])


@stage
def set_key(tournament: Tournament, i: int, time: float) -> None:
    """Give entry i another time in s."""
    key, winner = tournament.key, tournament.winner
    key[i] = time
    node = np.uint64((key.size + i) >> 1)
    while node > 0:
        child = node << np.uint64(1)
        upper = key[winner[child | np.uint64(1)]] < key[winner[child]]
        best = winner[child | np.uint64(upper)]
        if best == winner[node] and best != i:
            break
        winner[node] = best
        node >>= np.uint64(1)
