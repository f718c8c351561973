"""Kernels of a sample after its placement: the engine, and what is measured at the end."""

import math
from typing import Final

import numpy as np

import agglom_mpi.simulation.event_driven.engine
import agglom_mpi.simulation.time_driven.steppers  # noqa: F401  (all register their engines)
from agglom_mpi import outcome as result
from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.simulation.collision_counts import begin_counts
from agglom_mpi.simulation.measurement import (
    is_finite,
    measure,
    measure_initial,
    measure_ledger,
)
from agglom_mpi.simulation.particles import EXHAUSTED
from agglom_mpi.simulation.reference_frame import to_box_frame, to_mass_frame
from agglom_mpi.simulation.scene import advance_to, begin, finish
from agglom_mpi.simulation.spins import measure_spins, rotational_energy
from agglom_mpi.simulation.temperature import cool_until

INITIAL: Final = np.dtype(
    [("begun", "u1"), ("drift", "f8", 3), ("momentum", "f8", 3)]
    + [(name, "f8") for name in ("energy", "momentum_scale", "heat")]
)
"""State when a run begins, SI: the velocity of the frame of reference that the engine works in; in
it momentum, kinetic energy and sum of m|v|; heat above the scene's temperature."""


@kernel
def run_engine(scene, particles, ledger, engine_state, initial, until, abort):
    """Run particles on to a time; return the time reached in s.

    A run begins where `initial` says that it has not begun, and ends where `until` is the scene's
    end or the run ends earlier.

    Parameters
    ----------
    scene : Scene
    particles : Particles; at the end of the run, those at the time reached
    ledger : Ledger, added to
    engine_state : what `new_engine_state` returned for the scene
    initial : array of `INITIAL`, shape (1,), filled when the run begins
    until : float, s
    abort : uint8 array, shape (1,); anything but 0 ends the run early
    """
    begun = initial[0]["begun"]
    while True:
        # Compiled first, while another process compiles what a run begins with.
        if begun:
            time = advance_to(scene.engine, scene, particles, ledger, engine_state, until, abort)
            if until >= scene.end_time or time < until:
                finish(scene.engine, scene, particles, ledger, engine_state, time)
            return time
        measure_initial(scene, particles, to_mass_frame(scene, particles), initial[0])
        begin_counts(ledger.collisions, particles)
        begin(scene.engine, scene, particles, engine_state)
        begun = initial[0]["begun"]


@kernel
def measure_sample(scene, particles, ledger, initial, end, out):
    """Return particles at the time `end` in s to the frame of the box, and measure them.

    Parameters
    ----------
    scene, particles, ledger, initial
        As `run_engine` left them.
    end : float, s
    out : array of `outcome_type`, shape (1,), filled
    """
    record = out[0]
    record["end_time"] = end
    for i in range(particles.size[0]):
        cool_until(scene.cooling, scene, particles.records[i], ledger, end)
    if ledger.counts[EXHAUSTED] > 0:
        record["reason"] = result.FailureReason.BUDGET_EXCEEDED
        return
    turning = rotational_energy(scene.laws.friction, particles)
    if not (is_finite(particles) and math.isfinite(turning)):
        record["reason"] = result.FailureReason.NON_FINITE
        return
    measure(scene, particles, end, record)
    measure_spins(scene.laws.friction, scene.escape, particles, ledger, record)
    measure_ledger(scene, particles, ledger, initial[0], record)
    to_box_frame(scene, particles, initial[0]["drift"], end)
    record["state"] = result.COMPLETED
