"""How far collisions found by small steps may be from the exact ones, by exact runs.

A step finds a collision late by up to its length, with the two spheres displaced by no more than
they have flown since. What later collisions make of that, exact runs from displaced starts show.
"""

import itertools
from typing import NamedTuple

import numpy as np


class Expected(NamedTuple):
    """Collisions whose pairs no displacement changes: (time, i, j) each, and the times' change."""

    collisions: list
    changes: np.ndarray


def expected_collisions(run, positions, reach):
    """Return the first collisions of a run, and by how much displacements change their times.

    `run(positions)` returns collisions (time, i, j). Every coordinate of `positions`, (n, 3), is
    displaced by `reach` either way, one at a time. A displacement of all coordinates at once
    changes times by the sum of these changes at most, to first order.
    """
    exact = run(positions)
    same, changes = len(exact), np.zeros(len(exact))
    for i, axis in itertools.product(range(len(positions)), range(3)):
        moved = []
        for sign in (-1.0, 1.0):
            displaced = positions.copy()
            displaced[i, axis] += sign * reach
            found = run(displaced)
            agree = [one[1:] == other[1:] for one, other in zip(exact, found, strict=False)]
            same = min(same, agree.index(False) if False in agree else len(agree))
            moved.append([abs(o[0] - e[0]) for e, o in zip(exact[:same], found, strict=False)])
        changes[:same] += np.max([times[:same] for times in moved], axis=0)
    return Expected(exact[:same], changes[:same])
