"""What a scene has no use for is not there."""

import numpy as np
import pytest
from scenes import (
    breaking_adaptive_reentry,
    breaking_event_periodic,
    event_periodic,
    merging_event_periodic,
)

from agglom_mpi.physics.restitution import ContactTimeRestitution
from agglom_mpi.simulation.sample import simulate_scene

FEW = {"particles": 12, "size_ratio": 0.3, "end_time": 1e-4}
LEAN = event_periodic(0.9, **FEW)
ARRAYS = {
    "constant restitution": (LEAN, set()),
    "contact time": (
        LEAN._replace(laws=LEAN.laws._replace(restitution=ContactTimeRestitution(0.9, 1e-6))),
        {"struck"},
    ),
    "heat": (merging_event_periodic(2e4, **FEW), {"temperature"}),
    "heat, breakage, Euler cooling": (breaking_adaptive_reentry(**FEW), {"temperature", "grains"}),
    "heat, breakage, exact cooling": (
        breaking_event_periodic(**FEW),
        {"temperature", "grains", "touched"},
    ),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_a_scene_has_only_the_arrays_that_it_uses(name):
    scene, expected = ARRAYS[name]
    record, particles = simulate_scene(scene, np.random.default_rng(1))
    assert record["state"] == 1
    optional = ("temperature", "touched", "struck", "grains")
    assert {name for name in optional if getattr(particles, name) is not None} == expected
