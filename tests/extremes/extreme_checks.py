"""What must hold of a sample whatever its scene: conservation, bounds, no overlap that closes."""

import math
from typing import Any, NamedTuple

import numpy as np

from agglom_mpi.outcome import COMPLETED
from agglom_mpi.physics.cooling import ExactCooling
from agglom_mpi.physics.heating import OwnEnergy
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.particles import EXCHANGED, REACTION, SURFACE

ROUNDING = 2.0**-52
VANISHING = 1e-200
COUNTS = ("particles", "steps", "particle_steps", "collisions", "merges", "breakups")


class Motion(NamedTuple):
    """Momentum in kg m/s, and in the centre-of-mass frame energy in J and sum of m|v|."""

    momentum: np.ndarray
    energy: float
    impetus: float
    mass: float
    fastest: float
    """Largest speed in the frame of the box: what velocities are rounded to."""


def motion(particles):
    """Measure how particles move, summed with more digits than the simulator has."""
    n = int(particles.size[0])
    m = particles.mass[:n].astype(np.longdouble)
    v = particles.velocity[:, :n].astype(np.longdouble)
    momentum = v @ m
    own = v - (momentum / m.sum())[:, None]
    squares = np.sum(own**2, axis=0)
    return Motion(
        momentum,
        float(0.5 * m @ squares),
        float(m @ np.sqrt(squares)),
        float(m.sum()),
        float(np.abs(v).max(initial=0.0)),
    )


def assert_sound(scene, before, record, particles, ledger=None):
    """Check a completed sample of `scene` against its start.

    The ledger is needed if particles start at temperatures of their own.
    """
    n = int(record["particles"])
    assert record["state"] == COMPLETED
    assert particles.size[0] == n >= 1
    for name in record.dtype.names:
        assert math.isfinite(record[name]), name
    for values in (particles.position[:, :n], particles.velocity[:, :n]):
        assert np.all(np.isfinite(values))
    assert np.all(np.abs(particles.position[:, :n]) <= scene.half_width)
    assert np.all(particles.radius[:n] > 0.0)
    assert np.all(particles.mass[:n] > 0.0)
    assert record["end_time"] == scene.end_time
    assert record["merges"] <= record["collisions"]
    assert_nothing_is_lost(scene, before, record, particles)
    start = motion(before)
    share = 0.0
    if ledger is not None:
        flows = ledger.energy[[REACTION, SURFACE, EXCHANGED]].sum() + start.energy
        share = warmth(scene, before, particles, record) / flows if flows > 0.0 else 0.0
    assert_moves_on(scene, start, record, motion(particles), share)
    assert_temperatures(scene, before, record, particles)
    if isinstance(scene.engine, EventDriven.Numbers):
        assert len(closing_overlaps(scene, particles)) == 0


def assert_nothing_is_lost(scene, before, record, particles):
    start, n = int(before.size[0]), int(particles.size[0])
    assert particles.grains[:n].min() >= 1
    assert particles.grains[:n].sum() == before.grains[:start].sum()
    mass, volume = before.mass[:start].sum(), (before.radius[:start] ** 3).sum()
    assert math.isclose(particles.mass[:n].sum(), mass, rel_tol=1e-12)
    assert math.isclose((particles.radius[:n] ** 3).sum(), volume, rel_tol=1e-12)
    if record["breakups"] == 0:
        assert n == start - record["merges"]


def warmth(scene, before, particles, record):
    """What heat that flows between particles of different temperatures is rounded to, in J."""
    content = 0.0
    for state in (before, particles):
        n = int(state.size[0])
        content += state.mass[:n] @ np.abs(state.temperature[:n] - scene.temperature)
    roundings = scene.particles + 4.0 * record["collisions"]
    return ROUNDING * roundings * scene.laws.heat_capacity * content


def assert_moves_on(scene, start, record, end, share):
    """Momentum and, by the ledger, energy are kept.

    Velocities in the frame of the box are rounded there: twice for a periodic box that is left and
    entered again, and for two particles at every impact where the frame matters.
    """
    roundings = ROUNDING * (4.0 + 2.0 * record["collisions"])
    blur = roundings * start.fastest
    change = float(np.linalg.norm((end.momentum - start.momentum).astype(float)))
    assert change <= 1e-12 * start.impetus + blur * start.mass
    # The record sums up with as many roundings as there are particles.
    told = record["momentum_error"] * (start.impetus if start.impetus > 0.0 else 1.0)
    summing = ROUNDING * scene.particles * start.fastest
    assert told <= 1e-12 * start.impetus + (blur + summing) * start.mass
    if start.energy == 0.0 or isinstance(scene.laws.heating, OwnEnergy.Numbers):
        return
    jitter = (blur * start.impetus + 0.5 * start.mass * blur**2) / start.energy
    assert abs(record["energy_error"]) <= 1e-9 + 2.0 * jitter + share
    assert end.energy <= start.energy * (1.0 + 1e-9 + jitter)


def assert_temperatures(scene, before, record, particles):
    n, start = int(particles.size[0]), int(before.size[0])
    theta = particles.temperature[:n]
    assert np.all(np.isfinite(theta))
    assert np.all(theta >= 0.0)
    assert theta.min() <= record["mean_temperature"] <= theta.max()
    if isinstance(scene.laws.heating, OwnEnergy.Numbers) or not isinstance(
        scene.cooling, ExactCooling
    ):
        return
    assert record["floored_temperatures"] == 0
    coldest = min(before.temperature[:start].min(), scene.cooling.law.equilibrium)
    # An equilibrium below 1e-30 K counts as 0 K.
    assert theta.min() >= coldest * (1.0 - 1e-12) - 1e-30
    assert record["capped_iterations"] == 0
    assert record["largest_residual"] <= 1e-12


def closing_overlaps(scene, particles):
    """Pairs that overlap and approach, beyond rounding."""
    n = int(particles.size[0])
    low, high = np.triu_indices(n, 1)
    r, v, half = particles.position[:, :n].T, particles.velocity[:, :n].T, scene.half_width
    d = r[high] - r[low]
    if isinstance(scene.escape, Periodic.Numbers):
        d -= 2.0 * half * np.rint(d / (2.0 * half))
    distance = np.linalg.norm(d, axis=1)
    reach = particles.radius[low] + particles.radius[high]
    relative = v[high] - v[low]
    unit = d / np.where(distance > 0.0, distance, 1.0)[:, None]
    closing = np.sum(unit * relative, axis=1)
    depth = 1e-9 * np.maximum(reach, 1e-3 * half)
    slow = 1e-9 * np.linalg.norm(relative, axis=1) + 8.0 * ROUNDING * np.abs(v).max(initial=0.0)
    return np.flatnonzero((distance < reach - depth) & (closing < -slow))


def fingerprint(scene, record, particles):
    """Everything about a sample that does not depend on the units of length, mass and time."""
    n = int(record["particles"])
    numbers: dict[str, Any] = {name: record[name].item() for name in record.dtype.names}
    numbers["end_time"] = 0.0 if scene.end_time == 0.0 else numbers["end_time"] / scene.end_time
    # Where products come near the smallest number of float64, they lose digits.
    for name, value in numbers.items():
        numbers[name] = 0.0 if abs(value) < VANISHING else value
    return {
        **numbers,
        "position": (particles.position[:, :n] / scene.half_width).tolist(),
        "radius": (particles.radius[:n] / scene.radius).tolist(),
        "mass": (particles.mass[:n] / scene.mass).tolist(),
        "temperature": [t if t > VANISHING else 0.0 for t in particles.temperature[:n].tolist()],
        "grains": particles.grains[:n].tolist(),
    }
