"""What leaving out saves: submodels without effect against none, and the leanest scene's kernel.

Run with `pytest tests/benchmarks/bench_leave_out.py -m benchmark -s` (some minutes, most of them
compiling); `-k bare` is the second part. Processor time of one thread, the engine alone; runs of
what is compared take turns, each from the same start.
"""

import statistics
import time

import numpy as np
import pytest
from bare_kernels import (
    bare_state,
    events_of_bare_state,
    events_of_whole_state,
    steps_of_whole_state,
)
from bench_event import HALF, SPEED, make_gas, print_row, run_engine, start

from agglom_mpi.physics.contact import CompressionRecoveryDuration
from agglom_mpi.physics.cooling import EulerCooling, ExactCooling, RadiativeCooling
from agglom_mpi.physics.fragmentation import PairEnergyFragmentation
from agglom_mpi.physics.friction import ConstantFriction
from agglom_mpi.physics.hardness import ArrheniusHardness, ConstantHardness
from agglom_mpi.physics.heating import PairSplit
from agglom_mpi.physics.impact_solvers import BracketedRoot
from agglom_mpi.physics.reaction import ContactAreaReaction
from agglom_mpi.physics.restitution import LastingContact, PressureRestitution
from agglom_mpi.simulation.engines import FixedSteps
from agglom_mpi.simulation.event_driven.state import new_events
from agglom_mpi.simulation.particles import COLLISIONS
from agglom_mpi.simulation.time_driven.neighbours import new_neighbour_list

COUNT = 1000
RESTITUTION = 0.9
EACH = 20
"""Collisions per particle, about."""

STEP = 0.02
"""Fixed steps: way of the fastest component over the spacing of the particles."""

REPEATS = 41
SHADOW = RadiativeCooling.Numbers(0.0, 300.0, 0.0, 300.0, 300.0)


def gas(packing):
    return make_gas(packing, COUNT, RESTITUTION, EACH)


def stepped(scene):
    """Return a scene with fixed steps to a quarter of its end time."""
    end_time = 0.25 * scene.end_time
    step = STEP * 2.0 * HALF / COUNT ** (1.0 / 3.0) / SPEED
    return scene._replace(engine=FixedSteps.Numbers(int(end_time / step)), end_time=end_time)


def changed(scene, cooling=None, **laws):
    return scene._replace(laws=scene.laws._replace(**laws), cooling=cooling)


def pairs():
    """Return what is added without effect, a scene without it and the scene with it."""
    lean = gas(0.2)
    warm = changed(lean, heating=PairSplit.Numbers(), heat_capacity=500.0)
    steps = stepped(warm)
    hard = changed(
        warm,
        restitution=PressureRestitution.Numbers(),
        duration=CompressionRecoveryDuration.Numbers(1.0),
        hardness=ConstantHardness.Numbers(1e9),
        solver=BracketedRoot.Numbers(),
    )
    frail = PairEnergyFragmentation.Numbers(1e300)
    everything = {
        "restitution": LastingContact.Numbers(RESTITUTION, 0.0),
        "friction": ConstantFriction.Numbers(0.0),
        "reaction": ContactAreaReaction.Numbers(0.0),
        "fragmentation": frail,
    }
    return [
        ("friction, mu = 0", lean, changed(lean, friction=ConstantFriction.Numbers(0.0))),
        ("contact time 0", lean, changed(lean, restitution=everything["restitution"])),
        ("heating", lean, warm),
        ("reaction, kappa = 0", warm, changed(warm, reaction=ContactAreaReaction.Numbers(0.0))),
        ("fragmentation, gamma = 1e300", warm, changed(warm, fragmentation=frail)),
        ("cooling, emissivity 0", warm, changed(warm, ExactCooling(SHADOW))),
        ("the same in fixed Euler steps", steps, changed(steps, EulerCooling(SHADOW))),
        (
            "arrhenius hardness, U = 0",
            hard,
            changed(hard, hardness=ArrheniusHardness.Numbers(1e9, 0.0)),
        ),
        ("all but the last two", lean, changed(warm, ExactCooling(SHADOW), **everything)),
    ]


def package(scene, particles):
    """Run the engine that the package compiles for a scene; how many collisions."""
    return int(run_engine(scene, particles, np.zeros(1, np.uint8)).counts[COLLISIONS])


def bare(kernel):
    """Return how to run a bare kernel for its number of hits."""
    return lambda scene, state: int(kernel(scene, state, room_for(scene))[1])


def room_for(scene):
    """Return what an engine keeps beside the particles of a scene."""
    count = scene.particles
    if isinstance(scene.engine, FixedSteps.Numbers):
        return new_neighbour_list(count)
    return new_events(count, count)


def timed(run, scene, state):
    """Processor time per hit of a run from a copy of a state, and how many hits there were."""
    fresh = type(state)(*(None if array is None else array.copy() for array in state))
    begin = time.process_time()
    hits = run(scene, fresh)
    return (time.process_time() - begin) / hits, hits


def in_turns(runs):
    """Median processor times per hit of runs that take turns, and their hits."""
    hits = [timed(*each)[1] for each in runs]  # compiles
    seconds = [[timed(*each)[0] for each in runs] for _ in range(REPEATS)]
    return [statistics.median(column) for column in zip(*seconds, strict=True)], hits


@pytest.mark.benchmark
def test_print_what_submodels_without_effect_cost():
    print(f"\nphi = 0.2, {COUNT} grains, e = {RESTITUTION}, event engine; median of {REPEATS} runs")
    widths = (32, 20, 20, 12)
    print_row(widths, ("without effect", "ns/collision with", "ns without", "ratio"))
    for name, lean, general in pairs():
        runs = [(package, each, begin(each)) for each in (lean, general)]
        (absent, present), (hits, others) = in_turns(runs)
        assert hits == others
        row = (f"{present * 1e9:.0f}", f"{absent * 1e9:.0f}", f"{present / absent:.3f}")
        print_row(widths, (name, *row))


def begin(scene):
    return start(scene, np.random.default_rng(1))


BARE_WIDTHS = (8, 8, 22, 16, 16, 24)


@pytest.mark.benchmark
def test_print_the_leanest_scene_beside_bare_kernels():
    print(f"\n{COUNT} grains, e = {RESTITUTION}; median of {REPEATS} runs")
    titles = ("engine", "phi", "bare kernel", "its ns/hit", "package's", "package over bare")
    print_row(BARE_WIDTHS, titles)
    for packing in (0.2, 0.03):
        scene = gas(packing)
        steps, particles = stepped(scene), begin(scene)
        motion = bare_state(particles)
        kernels = {
            "same state": (bare(events_of_whole_state), scene, particles),
            "motion alone": (bare(events_of_bare_state), scene, motion),
        }
        print_bare("event", packing, (package, scene, particles), kernels)
        kernels = {"same state": (bare(steps_of_whole_state), steps, particles)}
        print_bare("fixed", packing, (package, steps, particles), kernels)


def print_bare(engine, packing, own, kernels):
    (seconds, *others), (hits, *found) = in_turns([own, *kernels.values()])
    for name, other, count in zip(kernels, others, found, strict=True):
        assert abs(count / hits - 1.0) < 0.1  # roundings differ, and in time so do collisions
        row = (f"{other * 1e9:.0f}", f"{seconds * 1e9:.0f}", f"{seconds / other:.3f}")
        print_row(BARE_WIDTHS, (engine, packing, name, *row))
