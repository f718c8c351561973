"""Scenes and states for tests of the simulator, and a kernel that runs an engine from a state."""

import math

import numpy as np

import agglom_mpi.simulation.event_driven.engine  # noqa: F401  (registers its engine)
from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.physics.contact import CompressionRecoveryDuration, ContactArea, MeanSpeedDuration
from agglom_mpi.physics.cooling import (
    EulerCooling,
    ExactCooling,
    RadiativeCooling,
    equilibrium_temperature,
)
from agglom_mpi.physics.fragmentation import OwnEnergyFragmentation, PairEnergyFragmentation
from agglom_mpi.physics.friction import ConstantFriction, RestitutionScaledFriction
from agglom_mpi.physics.hardness import ArrheniusHardness, ConstantHardness
from agglom_mpi.physics.heating import OwnEnergy, PairSplit
from agglom_mpi.physics.impact_solvers import BracketedRoot, FixedPointIteration
from agglom_mpi.physics.reaction import ContactAreaReaction
from agglom_mpi.physics.restitution import (
    ConstantRestitution,
    ImpactLaws,
    PressureRestitution,
)
from agglom_mpi.physics.size_distributions import LognormalDistribution
from agglom_mpi.physics.velocities import SpreadVelocities
from agglom_mpi.simulation.boundary import Periodic, Reentry
from agglom_mpi.simulation.engines import AdaptiveSteps, EventDriven, FixedSteps
from agglom_mpi.simulation.initial_state import EqualSizes, place_randomly
from agglom_mpi.simulation.particles import new_ledger, new_particles
from agglom_mpi.simulation.reference_frame import to_box_frame, to_mass_frame
from agglom_mpi.simulation.scene import Scene, new_engine_state, run_to_end
from agglom_mpi.simulation.time_driven import steppers as fixed  # noqa: F401  (register their engines)

HALF = 0.01
DENSITY = 5000.0
FLOOR, CEILING = 1e-6, 1e-3
BUDGET = 20_000

CONSTANT = ImpactLaws(
    restitution=ConstantRestitution.Numbers(1.0),
    duration=None,
    contact_area=ContactArea.Numbers(0.0, 1.0),
    hardness=None,
    friction=None,
    heating=None,
    reaction=None,
    fragmentation=None,
    solver=None,
    heat_capacity=math.inf,
)

MERGING = ImpactLaws(
    restitution=PressureRestitution.Numbers(),
    duration=None,
    contact_area=ContactArea.Numbers(0.0, 1.0),
    hardness=ConstantHardness.Numbers(1e7),
    friction=ConstantFriction.Numbers(0.2),
    heating=PairSplit.Numbers(),
    reaction=ContactAreaReaction.Numbers(100.0),
    fragmentation=None,
    solver=BracketedRoot.Numbers(),
    heat_capacity=500.0,
)
"""A closed form gives e, and everything else of an impact is at work; duration is added."""

BREAKING = MERGING._replace(
    hardness=ArrheniusHardness.Numbers(1e10, 700.0),
    friction=RestitutionScaledFriction.Numbers(0.2),
    fragmentation=PairEnergyFragmentation.Numbers(3.0),
)


def ball_mass(radius):
    return DENSITY * 4.0 / 3.0 * math.pi * radius**3


def make_scene(laws, engine, escape, particles, size_ratio, end_time, cooling=None, speed=10.0):
    radius = size_ratio * HALF / particles ** (1.0 / 3.0)
    return Scene(
        escape=escape,
        velocities=SpreadVelocities.Numbers((0.0, 0.0, 0.0), 1.0, speed),
        laws=laws,
        cooling=cooling,
        engine=engine,
        particles=particles,
        half_width=HALF,
        radius=radius,
        mass=ball_mass(radius),
        temperature=400.0,
        end_time=end_time,
    )


def fixed_periodic(restitution, steps, **options):
    laws = CONSTANT._replace(restitution=ConstantRestitution.Numbers(restitution))
    return make_scene(laws, FixedSteps.Numbers(steps), Periodic.Numbers(), **options)


def adaptive_reentry(restitution, floor=FLOOR, ceiling=CEILING, **options):
    laws = CONSTANT._replace(restitution=ConstantRestitution.Numbers(restitution))
    return make_scene(laws, AdaptiveSteps.Numbers(floor, ceiling), Reentry.Numbers(), **options)


def event_periodic(restitution, budget=BUDGET, **options):
    laws = CONSTANT._replace(restitution=ConstantRestitution.Numbers(restitution))
    return make_scene(laws, EventDriven.Numbers(budget), Periodic.Numbers(), **options)


def event_reentry(restitution, budget=BUDGET, **options):
    laws = CONSTANT._replace(restitution=ConstantRestitution.Numbers(restitution))
    return make_scene(laws, EventDriven.Numbers(budget), Reentry.Numbers(), **options)


def merging_fixed_reentry(hardness, steps, **options):
    laws = MERGING._replace(
        duration=MeanSpeedDuration.Numbers(1e-6), hardness=ConstantHardness.Numbers(hardness)
    )
    return make_scene(laws, FixedSteps.Numbers(steps), Reentry.Numbers(), **options)


def merging_adaptive_periodic(hardness, floor=FLOOR, ceiling=CEILING, **options):
    laws = MERGING._replace(
        duration=CompressionRecoveryDuration.Numbers(1.0),
        hardness=ConstantHardness.Numbers(hardness),
    )
    return make_scene(laws, AdaptiveSteps.Numbers(floor, ceiling), Periodic.Numbers(), **options)


def merging_event_periodic(hardness, **options):
    laws = MERGING._replace(
        duration=CompressionRecoveryDuration.Numbers(1.0),
        hardness=ConstantHardness.Numbers(hardness),
    )
    return make_scene(laws, EventDriven.Numbers(BUDGET), Periodic.Numbers(), **options)


def merging_event_reentry(hardness, **options):
    laws = MERGING._replace(
        duration=MeanSpeedDuration.Numbers(1e-6), hardness=ConstantHardness.Numbers(hardness)
    )
    return make_scene(laws, EventDriven.Numbers(BUDGET), Reentry.Numbers(), **options)


def radiation():
    rest = equilibrium_temperature(0.5, 300.0, 20.0, 350.0)
    return RadiativeCooling.Numbers(0.5, 300.0, 20.0, 350.0, rest)


def breaking_fixed_periodic(steps, **options):
    """Return a scene of [A] that also breaks and cools exactly."""
    laws = BREAKING._replace(duration=MeanSpeedDuration.Numbers(1e-6))
    return make_scene(
        laws,
        FixedSteps.Numbers(steps),
        Periodic.Numbers(),
        cooling=ExactCooling(radiation()),
        **options,
    )


def breaking_adaptive_reentry(floor=FLOOR, ceiling=CEILING, **options):
    """Return a scene of [B] that breaks and cools by Euler steps."""
    laws = BREAKING._replace(duration=CompressionRecoveryDuration.Numbers(1e-6))
    engine = AdaptiveSteps.Numbers(floor, ceiling)
    cooling = EulerCooling(radiation())
    return make_scene(laws, engine, Reentry.Numbers(), cooling=cooling, **options)


def breaking_event_periodic(**options):
    """Return a scene of the type that `jobs/agglomeration_2004.yaml` has."""
    scene = breaking_fixed_periodic(1, **options)
    laws = scene.laws._replace(
        duration=CompressionRecoveryDuration.Numbers(1e-6), friction=ConstantFriction.Numbers(0.2)
    )
    return scene._replace(engine=EventDriven.Numbers(BUDGET), laws=laws)


def breaking_event_reentry(**options):
    """Return the scene of `breaking_fixed_periodic` without its steps, and with real faces."""
    scene = breaking_fixed_periodic(1, **options)
    return scene._replace(engine=EventDriven.Numbers(BUDGET), escape=Reentry.Numbers())


def with_own_energies(scene, surface_energy):
    """Return a scene as [B] prints it: each sphere by its own kinetic energy, and no cooling."""
    laws = scene.laws._replace(
        heating=OwnEnergy.Numbers(), fragmentation=OwnEnergyFragmentation.Numbers(surface_energy)
    )
    return scene._replace(laws=laws, cooling=None)


def with_published_iteration(scene, tolerance, cap):
    """Return a scene whose restitution is iterated as published."""
    return scene._replace(
        laws=scene.laws._replace(solver=FixedPointIteration.Numbers(tolerance, cap))
    )


def image(difference, periodic):
    """Vector between two particles by minimum image, or as it is."""
    difference = np.asarray(difference)
    return difference - 2.0 * HALF * np.rint(difference / (2.0 * HALF)) if periodic else difference


def placed(scene, seed, velocities=None):
    """Place and launch the grains of a scene; written here, not by the simulator."""
    random = np.random.default_rng(seed)
    periodic = isinstance(scene.escape, Periodic.Numbers)
    positions = np.empty((0, 3))
    while len(positions) < scene.particles:
        trial = random.uniform(-HALF, HALF, 3)
        distances = np.linalg.norm(image(positions - trial, periodic), axis=1)
        if np.all(distances >= 2.0 * scene.radius):
            positions = np.vstack((positions, trial))
    if velocities is None:
        velocities = scene.velocities.relative_speed * random.uniform(
            -1.0, 1.0, (scene.particles, 3)
        )
    return state(scene, positions, velocities)


def state(scene, positions, velocities, radii=None):
    """Particles at given places, one row each, with the fields that the scene has a use for."""
    count = len(positions)
    particles = new_particles(scene, count)
    particles.size[0] = particles.labels_given[0] = count
    particles.position[:] = np.asarray(positions, dtype=float).T
    particles.velocity[:] = np.asarray(velocities, dtype=float).T
    particles.radius[:] = scene.radius if radii is None else radii
    particles.mass[:] = [ball_mass(radius) for radius in particles.radius]
    return particles


@kernel
def run_engine(scene, particles, ledger, engine_state, abort):
    drift = to_mass_frame(scene, particles)
    time = run_to_end(scene, particles, ledger, engine_state, abort)
    to_box_frame(scene, particles, drift, time)
    return time


@kernel
def place_spheres(random, escape, position, diameter, half_width):
    abort = np.zeros(1, np.uint8)
    return place_randomly(random, escape, position, EqualSizes(diameter), half_width, abort)


def run_from(scene, particles):
    """Run the engine of a scene on particles, in place; its ledger and the time reached."""
    ledger = new_ledger()
    engine_state = new_engine_state(scene.engine, scene, particles.mass.size)
    time = run_engine(scene, particles, ledger, engine_state, np.zeros(1, np.uint8))
    return ledger, time


def grains_in(scene, particles):
    """Grains in each particle left: as counted, or by mass in a scene where nothing breaks."""
    n = int(particles.size[0])
    if particles.grains is not None:
        return particles.grains[:n]
    grains = particles.mass[:n] / scene.mass
    np.testing.assert_allclose(grains, np.rint(grains), rtol=1e-12)
    return np.rint(grains)


def temperatures_in(scene, particles):
    """Temperatures of the particles left, where the scene keeps any; else the one of all."""
    n = int(particles.size[0])
    kept = particles.temperature
    return np.full(n, scene.temperature) if kept is None else kept[:n]


def kinetic_energy(particles):
    n = int(particles.size[0])
    return 0.5 * float(np.sum(particles.mass[:n] * np.sum(particles.velocity[:, :n] ** 2, axis=0)))


def momentum(particles):
    n = int(particles.size[0])
    return particles.velocity[:, :n] @ particles.mass[:n]


SMALL = {"particles": 12, "size_ratio": 0.5, "end_time": 1e-3}
SMALL_SCENES = {
    "event": event_periodic(0.9, **SMALL),
    "event, different sizes": event_periodic(0.9, **SMALL)._replace(
        sizes=LognormalDistribution(0.3)
    ),
    "fixed": fixed_periodic(0.9, 20, **SMALL),
    "event, breaking": breaking_event_periodic(**SMALL),
}
"""Samples that take no time, one for each kind of kernels."""
