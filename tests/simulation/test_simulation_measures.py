"""What is measured at the end of a sample."""

import numpy as np
import pytest
from plain_python import PLAIN
from scenes import CONSTANT as LAWS
from scenes import HALF, image, make_scene, state

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.simulation.boundary import Periodic, Reentry
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.measurement import count_overlaps


@kernel
def overlaps(scene, particles):
    return count_overlaps(scene, particles, 0.0)


def counted_plainly(positions, radii, periodic):
    """Pairs of spheres whose distance is below the sum of their radii, all looked at."""
    found = 0
    for i in range(len(radii)):
        distances = np.linalg.norm(image(positions[i + 1 :] - positions[i], periodic), axis=1)
        found += int(np.sum(distances < radii[i] + radii[i + 1 :]))
    return found


@pytest.mark.parametrize(
    "escape",
    [
        pytest.param(Periodic.Numbers(), id="periodic"),
        pytest.param(Reentry.Numbers(), id="reentry", marks=PLAIN),
    ],
)
@pytest.mark.parametrize("oversize", [0, 1, 7])
@pytest.mark.parametrize("count", [3, 40, 400])
def test_overlaps_are_counted_as_by_looking_at_all_pairs(escape, oversize, count):
    random = np.random.default_rng(count + oversize)
    scene = make_scene(LAWS, EventDriven.Numbers(1), escape, count, 0.5, 1.0)
    positions = random.uniform(-HALF, HALF, (count, 3))
    radii = scene.radius * random.uniform(0.5, 2.0, count)
    radii[:oversize] = HALF * random.uniform(0.2, 0.6, min(oversize, count))
    particles = state(scene, positions, np.zeros((count, 3)), radii)
    expected = counted_plainly(positions, radii, isinstance(escape, Periodic.Numbers))
    assert expected > 0 or count == 3
    assert overlaps(scene, particles) == expected
