"""Overlaps that the model allows: spheres that part."""

from pathlib import Path

import numpy as np
import pytest

from agglom_mpi.accuracy.soundness import approaching_overlaps, overlaps_part
from agglom_mpi.config.loading import load_campaign

LATE_BONDING = Path(__file__).parent / "late_bonding.yaml"
"""A cell of a map of [A], of thermal softening against impact pressure."""


@pytest.mark.parametrize(
    ("distance", "speed", "expected"),
    [(1.5, -1.0, 1), (1.5, 1.0, 0), (1.5, 0.0, 0), (2.5, -1.0, 0)],
)
@pytest.mark.parametrize("period", [np.inf, 20.0])
@pytest.mark.parametrize("turn", [0, 1, 2])
def test_pairs_that_overlap_and_approach_are_counted(distance, speed, expected, period, turn):
    positions = np.roll(np.array([[0.0, 0, 0], [distance, 0, 0], [-9, 0, 0]]), turn, axis=1)
    velocities = np.roll(np.array([[0.0, 3, 0], [speed, 3, 0], [0, 0, 0]]), turn, axis=1)
    assert approaching_overlaps(positions, velocities, np.ones(3), period) == expected


def test_contacts_across_a_face_need_a_periodic_box():
    positions = np.array([[-4.5, 0.0, 0.0], [4.5, 0.0, 0.0]])
    velocities = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert approaching_overlaps(positions, velocities, np.ones(2), 10.0) == 1
    assert approaching_overlaps(positions, velocities, np.ones(2), np.inf) == 0


def test_aggregates_that_have_grown_into_a_neighbour_part_from_it():
    assert overlaps_part(load_campaign(LATE_BONDING), range(5))
