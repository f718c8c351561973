"""Candidate lists against all pairs, step after step of random motion."""

from typing import NamedTuple

import numba
import numpy as np
import pytest
from scenes import CONSTANT, HALF, image, make_scene, state

from agglom_mpi.compilation.stages import Submodel
from agglom_mpi.simulation.boundary import Periodic, Reentry
from agglom_mpi.simulation.time_driven.neighbours import (
    LISTED,
    find_partners,
    new_neighbour_list,
    update_neighbours,
)

pytestmark = pytest.mark.plain


class Box(NamedTuple):
    escape: Submodel
    half_width: float


@numba.njit(error_model="numpy")
def look(box, particles, neighbours, time, compacted, wanted, reach, partner, squared):
    update_neighbours(box, particles, neighbours, time, compacted, wanted)
    find_partners(box, particles, neighbours, partner, squared, reach)


def brute_force(position, periodic):
    partners, distances = [], []
    for i in range(position.shape[1]):
        away = np.linalg.norm(image(position - position[:, [i]], periodic), axis=0)
        away[i] = np.inf
        partners.append(int(np.argmin(away)))
        distances.append(away.min())
    return np.array(partners), np.array(distances)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("count", "drift", "escape"),
    [
        (60, 30.0, Periodic.Numbers()),
        pytest.param(60, 0.0, Reentry.Numbers(), marks=SLOW),
        pytest.param(900, 0.0, Periodic.Numbers(), marks=SLOW),
        pytest.param(300, 30.0, Reentry.Numbers(), marks=SLOW),
    ],
)
@pytest.mark.parametrize("reach", ["contacts", "all"])
def test_the_lists_name_the_same_partners_as_a_look_at_all(escape, count, drift, reach):
    random = np.random.default_rng(count)
    box = Box(escape, HALF)
    scene = make_scene(CONSTANT, None, escape, count, 0.6, 1.0)
    velocities = random.uniform(-1.0, 1.0, (count, 3)) + np.array([drift, 0.0, 0.5 * drift])
    # Clusters and voids: a third of the particles sits in one corner.
    places = random.uniform(-HALF, HALF, (count, 3))
    places[: count // 3] = random.uniform(-HALF, -0.4 * HALF, (count // 3, 3))
    radii = scene.radius * random.choice([1.0, 1.5], count)
    particles = state(scene, places, velocities, radii)
    neighbours = new_neighbour_list(count)
    partner, squared = np.empty(count, np.int64), np.empty(count)
    step = 0.03 * 2.0 * HALF / count ** (1.0 / 3.0)
    largest = radii.max()
    sure = np.inf if reach == "all" else largest
    listed = 0
    for index in range(60):
        wanted = np.inf if reach == "all" else 2.0 * largest
        look(box, particles, neighbours, index * step, index == 0, wanted, sure, partner, squared)
        listed += neighbours.counts[LISTED] > 0
        expected, distances = brute_force(particles.position, isinstance(escape, Periodic.Numbers))
        certain = distances <= radii + sure
        np.testing.assert_array_equal(partner[certain], expected[certain])
        np.testing.assert_allclose(np.sqrt(squared[certain]), distances[certain], rtol=1e-12)
        assert np.all(np.sqrt(squared[~certain]) >= (radii + sure)[~certain])
        changed = particles.position + step * particles.velocity
        # Both escapes of a step: around the box, or back on the opposite face
        if isinstance(escape, Periodic.Numbers):
            particles.position[:] = (changed + HALF) % (2.0 * HALF) - HALF
        else:
            particles.position[:] = np.where(
                np.abs(changed) > HALF, -np.sign(changed) * HALF, changed
            )
    assert listed > 30
