"""Laws of one's own beside the package's: each a copy in a module, compiled into the same engine.

Run with `pytest tests/benchmarks/bench_own_laws.py -m benchmark -s` (some minutes, most of them
compiling). Processor time of one thread, the engine alone; runs of a law and of its copy take
turns in one process, each from the same start, and must collide the same number of times.
"""

import math
import statistics
import time

import numpy as np
import pytest
from bench_event import make_gas, print_row, run_engine, start
from own_components import copies

from agglom_mpi.declaration.own_modules import OwnModule, class_in
from agglom_mpi.physics.contact import CompressionRecoveryDuration
from agglom_mpi.physics.cooling import ExactCooling, RadiativeCooling
from agglom_mpi.physics.friction import ConstantFriction
from agglom_mpi.physics.hardness import ConstantHardness
from agglom_mpi.physics.heating import PairSplit
from agglom_mpi.physics.impact_solvers import BracketedRoot
from agglom_mpi.physics.restitution import ConstantRestitution, LastingContact, PressureRestitution
from agglom_mpi.simulation.particles import COLLISIONS

COUNT = 1000
RESTITUTION = 0.9
COLLISIONS_PER_GRAIN = 20
REPEATS = 61
WIDTHS = (24, 18, 14, 24)


def copied(law, *more):
    """Return the class of a module that has a copy of a law."""
    return class_in(OwnModule.of("mine.py", copies(law, *more).encode()), law.__name__)


def pairs():
    """Return names of laws, and scenes with each and with its copy."""
    gas = make_gas(0.2, COUNT, RESTITUTION, COLLISIONS_PER_GRAIN)
    warm = gas._replace(
        laws=gas.laws._replace(heating=PairSplit.Numbers(), heat_capacity=500.0), temperature=300.0
    )
    hard = warm._replace(
        laws=warm.laws._replace(
            restitution=PressureRestitution.Numbers(),
            duration=CompressionRecoveryDuration.Numbers(1.0),
            hardness=ConstantHardness.Numbers(1e9),
            solver=BracketedRoot.Numbers(),
        )
    )

    def with_law(scene, **laws):
        return scene._replace(laws=scene.laws._replace(**laws))

    constant = copied(ConstantRestitution, LastingContact)
    friction = copied(ConstantFriction)
    cooling = 0.9, 300.0, 2.0, 250.0, 290.0
    cooled = [
        ExactCooling(law.Numbers(*cooling)) for law in (RadiativeCooling, copied(RadiativeCooling))
    ]
    numbers = gas.laws.restitution
    return [
        ("restitution: constant", gas, with_law(gas, restitution=constant.Numbers(*numbers))),
        (
            "restitution: pressure",
            hard,
            with_law(hard, restitution=copied(PressureRestitution).Numbers()),
        ),
        (
            "friction: constant",
            with_law(gas, friction=ConstantFriction.Numbers(0.2)),
            with_law(gas, friction=friction.Numbers(0.2)),
        ),
        ("cooling: radiation", *(warm._replace(cooling=law) for law in cooled)),
    ]


def timed(scene, particles):
    """Return the processor time of a run from a copy of particles in s, and its collisions."""
    fresh = type(particles)(*(None if each is None else each.copy() for each in particles))
    begin = time.process_time()
    ledger = run_engine(scene, fresh, np.zeros(1, np.uint8))
    return time.process_time() - begin, int(ledger.counts[COLLISIONS])


@pytest.mark.benchmark
def test_print_what_laws_of_one_s_own_cost():
    print(f"\nphi = 0.2, {COUNT} grains, event engine; {REPEATS} runs of each, in turns")
    print_row(WIDTHS, ("law", "ns/collision", "its copy", "ratio of the medians"))
    for name, *scenes in pairs():
        runs = [(scene, start(scene, np.random.default_rng(1))) for scene in scenes]
        hits = {timed(*each)[1] for each in runs}  # compiles
        assert len(hits) == 1
        rounds = [[timed(*each)[0] for each in runs] for _ in range(REPEATS)]
        own, other = (statistics.median(column) for column in zip(*rounds, strict=True))
        ratios = [second / first for first, second in rounds]
        error = 1.2533 * statistics.stdev(ratios) / math.sqrt(REPEATS)  # of a median
        each = 1e9 / hits.pop()
        row = (f"{own * each:.1f}", f"{other * each:.1f}", f"{other / own:.3f} ± {error:.3f}")
        print_row(WIDTHS, (name, *row))
