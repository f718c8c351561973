"""Random sequential placement: nothing overlaps, all is inside, no place is preferred."""

import math

import numpy as np
import pytest
from plain_python import PLAIN
from scenes import HALF, breaking_event_periodic, image, place_spheres
from scipy.spatial.distance import pdist

from agglom_mpi.outcome import FAILED, FailureReason
from agglom_mpi.simulation.boundary import Periodic, Reentry
from agglom_mpi.simulation.sample import simulate_scene


def placement(seed, escape, count, size_ratio):
    diameter = 2.0 * HALF * size_ratio / count ** (1.0 / 3.0)
    position = np.full((3, count), np.nan)
    assert place_spheres(np.random.default_rng(seed), escape, position, diameter, HALF)
    return position, diameter


SIZES = [(2, 0.8), (9, 0.8), (30, 0.85), (100, 0.8), (1000, 0.8), (300, 0.05)]


@pytest.mark.parametrize(
    ("count", "size_ratio", "escape"),
    [
        *((*size, Periodic.Numbers()) for size in SIZES),
        *(pytest.param(*size, Reentry.Numbers(), marks=PLAIN) for size in SIZES[:3]),
        *(pytest.param(*size, Reentry.Numbers(), marks=pytest.mark.slow) for size in SIZES[3:]),
    ],
)
def test_no_two_spheres_overlap_and_all_are_inside(escape, count, size_ratio):
    position, diameter = placement(3, escape, count, size_ratio)
    assert np.all(np.abs(position) <= HALF)
    periodic = isinstance(escape, Periodic.Numbers)
    for i in range(count - 1):
        away = image(position[:, i + 1 :] - position[:, [i]], periodic)
        assert np.min(np.linalg.norm(away, axis=0)) >= diameter * (1.0 - 1e-12)


@pytest.mark.plain
def test_a_run_that_is_to_end_looks_for_no_place():
    scene = breaking_event_periodic(particles=9, size_ratio=0.5, end_time=1e-4)
    random, unused = np.random.default_rng(1), np.random.default_rng(1)
    record, _ = simulate_scene(scene, random, np.ones(1, np.uint8))
    assert record["state"] == FAILED
    assert random.random() == unused.random()


def test_the_centres_fill_the_box_evenly():
    """Exclusion only narrows the binomial spread, of which four standard deviations are allowed."""
    count = 4000
    position, _ = placement(5, Periodic.Numbers(), count, 0.5)
    mean_error = 2.0 * HALF / math.sqrt(12.0 * count)
    assert np.all(np.abs(position.mean(axis=1)) <= 4.0 * mean_error)
    octant = (position > 0.0).T @ np.array([1, 2, 4])
    spread = math.sqrt(count / 8.0 * 7.0 / 8.0)
    assert np.all(np.abs(np.bincount(octant, minlength=8) - count / 8.0) <= 4.0 * spread)


def test_points_are_as_near_to_each_other_as_independent_ones():
    """Of independent points a share (4/3)πr³/V of all pairs is within r by minimum image."""
    count, reach = 1500, 0.5 * HALF
    position, _ = placement(7, Periodic.Numbers(), count, 1e-6)
    near = 0
    for i in range(count - 1):
        away = np.linalg.norm(image(position[:, i + 1 :] - position[:, [i]], True), axis=0)
        near += np.count_nonzero(away < reach)
    share = 4.0 / 3.0 * math.pi * reach**3 / (2.0 * HALF) ** 3
    pairs = count * (count - 1) / 2.0
    # Pair distances in a periodic box are pairwise independent, so the variance is binomial.
    assert abs(near - share * pairs) <= 4.0 * math.sqrt(pairs * share * (1.0 - share))


def test_spheres_may_lie_across_the_faces():
    position, diameter = placement(11, Periodic.Numbers(), 500, 0.6)
    assert np.count_nonzero(np.abs(position) > HALF - 0.5 * diameter) > 50
    assert pdist(position.T).min() >= diameter * (1.0 - 1e-12)


def test_a_jammed_placement_is_a_failed_record():
    """No two points of a periodic cube are farther apart than √3 half-widths."""
    scene = breaking_event_periodic(particles=2, size_ratio=0.5, end_time=1e-4)
    scene = scene._replace(radius=0.5 * 1.001 * math.sqrt(3.0) * HALF)
    record, _ = simulate_scene(scene, np.random.default_rng(1))
    assert record["state"] == FAILED
    assert record["reason"] == FailureReason.PLACEMENT_JAMMED
    assert record["steps"] == 0
