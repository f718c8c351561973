"""What a scene has no use for is not there, and leaving it out does not change a bit."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from plain_python import PLAIN_ALONE, cases
from scenes import (
    CEILING,
    CONSTANT,
    FLOOR,
    breaking_adaptive_reentry,
    breaking_event_periodic,
    event_periodic,
    make_scene,
    merging_event_periodic,
)

from agglom_mpi.config.describe import missing_fields
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import OUTCOME
from agglom_mpi.physics.contact import CompressionRecoveryDuration
from agglom_mpi.physics.cooling import EulerCooling, ExactCooling, RadiativeCooling
from agglom_mpi.physics.fragmentation import PairEnergyFragmentation
from agglom_mpi.physics.friction import ConstantFriction
from agglom_mpi.physics.hardness import ArrheniusHardness, ConstantHardness
from agglom_mpi.physics.heating import PairSplit
from agglom_mpi.physics.impact_solvers import BracketedRoot
from agglom_mpi.physics.reaction import ContactAreaReaction
from agglom_mpi.physics.restitution import (
    ConstantRestitution,
    LastingContact,
    PressureRestitution,
)
from agglom_mpi.physics.rough import RoughFriction
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.engines import AdaptiveSteps, EventDriven, FixedSteps
from agglom_mpi.simulation.event_driven.flights import NEXT_EVENT, TRAJECTORY
from agglom_mpi.simulation.particles import particle_type, particle_type_of
from agglom_mpi.simulation.sample import INITIAL, simulate_scene

pytestmark = PLAIN_ALONE

FEW = {"particles": 12, "size_ratio": 0.3, "end_time": 1e-4}
LEAN = event_periodic(0.9, **FEW)
ALWAYS = {"x", "y", "z", "u", "v", "w", "radius", "mass", "label"}
FIELDS = {
    "constant restitution": (LEAN, set()),
    "contact time": (
        LEAN._replace(laws=LEAN.laws._replace(restitution=LastingContact.Numbers(0.9, 1e-6))),
        {"last_impact"},
    ),
    "heat": (merging_event_periodic(2e4, **FEW), {"temperature"}),
    "heat, breakage, Euler cooling": (breaking_adaptive_reentry(**FEW), {"temperature", "grains"}),
    "heat, breakage, exact cooling": (
        breaking_event_periodic(**FEW),
        {"temperature", "grains", "cooled_to"},
    ),
    "rough grains": (
        LEAN._replace(laws=LEAN.laws._replace(friction=RoughFriction.Numbers(0.0, 0.2, 0.4))),
        {"spin_x", "spin_y", "spin_z"},
    ),
}


QUICK = ["constant restitution", "contact time", "heat, breakage, exact cooling"]


@pytest.mark.parametrize("name", cases(FIELDS, QUICK))
def test_a_particle_has_only_the_fields_that_its_scene_uses(name):
    scene, expected = FIELDS[name]
    record, particles = simulate_scene(scene, np.random.default_rng(1))
    assert record["state"] == 1
    assert set(particles.records.dtype.names) - ALWAYS == expected


def test_no_record_begins_with_all_fields_of_another():
    """Numba would take the longer one for the shorter."""
    kinds = [particle_type(*chosen) for chosen in itertools.product((False, True), repeat=5)]
    kinds += [TRAJECTORY, NEXT_EVENT, INITIAL, OUTCOME]
    fields = [[(name, kind.fields[name]) for name in kind.names] for kind in kinds]
    for shorter, longer in itertools.permutations(fields, 2):
        assert longer[: len(shorter)] != shorter


# What `agglom check` calls the fields that a scene may do without.
NAMES = {
    "temperature": "temperature",
    "time of last cooling": "cooled_to",
    "time of last impact": "last_impact",
    "number of grains": "grains",
}
FILES = sorted((Path(__file__).parents[2] / "jobs").glob("**/*.yaml"))
JOBS = [path for path in FILES if "\nscene:" in path.read_text()]  # the others are studies


@pytest.mark.parametrize("job", JOBS, ids=lambda job: job.stem)
def test_what_a_campaign_says_it_does_not_know_of_a_particle_is_not_allocated(job):
    campaign = load_campaign(job, allow_code=True)
    scene = campaign.at(campaign.parameters()).build()
    fields = particle_type_of(scene).names
    assert missing_fields(campaign.scene) == [n for n, name in NAMES.items() if name not in fields]


CROWD = {"particles": 120, "size_ratio": 0.8, "end_time": 1e-3}
SOME = {"particles": 30, "size_ratio": 0.8, "end_time": 3e-3}
SHADOW = RadiativeCooling.Numbers(0.0, 300.0, 0.0, 300.0, 300.0)
"""Radiation of what neither emits nor absorbs."""

CONSTANT_RESTITUTION = CONSTANT._replace(restitution=ConstantRestitution.Numbers(0.9))
PRESSURE = CONSTANT._replace(
    restitution=PressureRestitution.Numbers(),
    duration=CompressionRecoveryDuration.Numbers(1.0),
    hardness=ConstantHardness.Numbers(2e5),
    solver=BracketedRoot.Numbers(),
)
"""Some bond, most bounce."""


def with_inert_parts(scene):
    """Add every submodel that the scene has left out, so that it has no effect on motion."""
    laws = scene.laws._replace(
        friction=ConstantFriction.Numbers(0.0),
        heating=PairSplit.Numbers(),
        reaction=ContactAreaReaction.Numbers(0.0),
        fragmentation=PairEnergyFragmentation.Numbers(1e300),
        heat_capacity=500.0,
    )
    if laws.hardness is None:
        laws = laws._replace(restitution=LastingContact.Numbers(laws.restitution.value, 0.0))
    else:
        laws = laws._replace(hardness=ArrheniusHardness.Numbers(laws.hardness.hardness, 0.0))
    cooling = EulerCooling if isinstance(scene.engine, AdaptiveSteps.Numbers) else ExactCooling
    return scene._replace(laws=laws, cooling=cooling(SHADOW))


LAWS_AND_ENGINES = {
    "event": (CONSTANT_RESTITUTION, EventDriven.Numbers(20_000)),
    "event, all bond": (
        CONSTANT_RESTITUTION._replace(restitution=ConstantRestitution.Numbers(0.0)),
        EventDriven.Numbers(20_000),
    ),
    "event, pressure": (PRESSURE, EventDriven.Numbers(20_000)),
    "fixed": (CONSTANT_RESTITUTION, FixedSteps.Numbers(200)),
    "adaptive": (CONSTANT_RESTITUTION, AdaptiveSteps.Numbers(FLOOR, CEILING)),
}


SLOW = pytest.mark.slow
COMPILED = ["event, pressure", "fixed", "adaptive"]


@pytest.mark.parametrize(
    ("name", "crowd"),
    [
        *(pytest.param(n, CROWD, marks=SLOW, id=n) for n in COMPILED),
        *(
            pytest.param(n, SOME, id=f"{n}, some")
            for n in LAWS_AND_ENGINES
            if n.startswith("event")
        ),
    ],
)
def test_submodels_without_effect_do_not_change_a_bit(name, crowd):
    lean = make_scene(*LAWS_AND_ENGINES[name], Periodic.Numbers(), **crowd)
    record, particles = simulate_scene(lean, np.random.default_rng(0))
    general, others = simulate_scene(with_inert_parts(lean), np.random.default_rng(0))
    assert record["collisions"] > 100 or record["merges"] > 20
    for count in ("steps", "collisions", "merges", "particles", "overlaps"):
        assert general[count] == record[count]
    assert general["breakups"] == 0
    left = int(record["particles"])
    assert others.radius[:left].tobytes() == particles.radius[:left].tobytes()
    assert others.position[:, :left].tobytes() == particles.position[:, :left].tobytes()
    assert others.velocity[:, :left].tobytes() == particles.velocity[:, :left].tobytes()
    assert others.temperature[:left].max() > lean.temperature  # the heat is at work
