"""The same grains in REBOUND (Rein & Liu 2012), which finds collisions as overlaps after a step.

Set up as fast as it goes and stays right: tree search, no gravity, its own compiled `hardsphere`
resolution with a compiled restitution, and a step that grows as the grains slow down. `linetree`
gains nothing, since `hardsphere` refuses pairs that do not overlap at the end of a step; `direct`
is slower from 100 grains on. Release 4.6 bounces about a quarter faster than 5.2, but there a
grain in a tree can merge twice in a step, which does not conserve mass.
"""

import ctypes
import functools
import math
import time
from typing import NamedTuple

import numba
import numpy as np

try:
    import rebound
    from rebound.simulation import COLRFF, CORFF
except ImportError:
    rebound = None

MISSING = "REBOUND is left out: it is not installed (pip install 'agglom_mpi[bench]')"


class Grains(NamedTuple):
    """Equal grains in a periodic cube around 0: shapes (N, 3), and SI numbers."""

    position: np.ndarray
    velocity: np.ndarray
    radius: float
    mass: float
    side: float


class Run(NamedTuple):
    """What a run did; `speed` is the spread of a component, `mass` that of all grains."""

    seconds: float
    steps: int
    collisions: int
    left: int
    speed: float
    mass: float


def title():
    return f"REBOUND {rebound.__version__}"


def bounce(grains, restitution, ends, share):
    """Let grains bounce until the last of `ends`.

    Between two of these times the step is `share` of a radius over the speed at the first.
    """
    simulation = make_simulation(grains)
    simulation.collision_resolve = "hardsphere"
    if restitution != 1.0:
        # The public setter would wrap the compiled function in a Python callback.
        simulation._coefficient_of_restitution = CORFF(restitution_callback(restitution).address)
    return timed(simulation, ends, share)


def merge(grains, ends, share):
    """As `bounce`, but whoever touches becomes one sphere."""
    simulation = make_simulation(grains)
    simulation.collision_resolve = merge_across_faces
    return timed(simulation, ends, share)


def make_simulation(grains):
    simulation = rebound.Simulation()
    if hasattr(simulation, "configure_box"):  # before release 5
        simulation.configure_box(grains.side)
    else:
        simulation.root_size = grains.side
    simulation.integrator = "leapfrog"
    simulation.gravity = "none"
    simulation.boundary = "periodic"
    simulation.N_ghost_x = simulation.N_ghost_y = simulation.N_ghost_z = 1
    simulation.collision = "tree"
    simulation.rand_seed = 1
    simulation.minimum_collision_velocity = 0.0
    for (x, y, z), (vx, vy, vz) in zip(
        grains.position.tolist(), grains.velocity.tolist(), strict=True
    ):
        simulation.add(m=grains.mass, r=grains.radius, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz)
    return simulation


@functools.cache
def restitution_callback(value):
    return numba.cfunc("float64(voidptr, float64)")(lambda simulation, speed: value)


def merge_across_faces(simulation, collision):
    """Merge as REBOUND does, but across a face as well, where it would average both sides.

    A Python call for each merger; it costs a few per cent.
    """
    particle = simulation.contents._particles[collision.p1]
    particle.x += collision.gb.x
    particle.y += collision.gb.y
    particle.z += collision.gb.z
    return compiled_merge()(simulation, collision)


@functools.cache
def compiled_merge():
    address = ctypes.cast(rebound.clibrebound.reb_collision_resolve_merge, ctypes.c_void_p).value
    return COLRFF(address)


def timed(simulation, ends, share):
    steps = 0
    begin = time.perf_counter()
    for end in ends:
        steps += advance(simulation, end, share)
    seconds = time.perf_counter() - begin
    left = simulation.N
    collisions = simulation.collisions_log_n
    return Run(
        seconds, steps, collisions, left, speed(simulation), float(values(simulation, "m").sum())
    )


def advance(simulation, end, share):
    """Take equal steps to `end`; how many."""
    wanted = share * values(simulation, "r").mean() / speed(simulation)
    steps = max(1, math.ceil((end - simulation.t) / wanted))
    simulation.dt = (end - simulation.t) / steps
    simulation.steps(steps)
    return steps


def values(simulation, name, components=1):
    found = np.empty((simulation.N, components))
    simulation.serialize_particle_data(**{name: found})
    return found


def speed(simulation):
    return float(np.sqrt(np.mean(np.var(values(simulation, "vxvyvz", 3), axis=0))))
