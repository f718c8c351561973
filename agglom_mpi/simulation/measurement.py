"""Quantities that are measured of a sample."""

import math
from typing import Any

import numpy as np

from agglom_mpi.compilation.stages import inlined, inlined_allocating
from agglom_mpi.simulation.boundary import (
    cells_of,
    image_offset,
    is_sheared,
    nearest_image,
    sort_into_cells,
    wrapped_cell,
)
from agglom_mpi.simulation.particles import (
    BREAKUPS,
    CAPPED,
    COLLISIONS,
    DISSIPATED,
    EXCHANGED,
    FLOORED,
    MERGES,
    PARTICLE_STEPS,
    RADIATED,
    REACTION,
    STEPS,
    SURFACE,
    UNRESOLVED,
    WORK,
    largest_radius,
    temperature_or,
)
from agglom_mpi.simulation.reference_frame import fluctuation_energy, total_momentum
from agglom_mpi.simulation.shear import columns_beside
from agglom_mpi.simulation.spins import mechanical_energy
from agglom_mpi.simulation.time_driven.neighbours import square_of, squared_distance


@inlined
def thermal_energy(heating, scene, particles):
    """Thermal energy in J above the scene's temperature; 0 where nothing heats."""
    energy = 0.0
    if heating is not None:
        capacity = scene.laws.heat_capacity
        for i in range(particles.size[0]):
            particle = particles.records[i]
            excess = particle["temperature"] - scene.temperature
            energy += particle["mass"] * capacity * excess
    return energy


@inlined
def cell_edge(particles):
    """Edge in m of cells for most spheres: the largest diameter, at most twice the mean one."""
    total = 0.0
    for i in range(particles.size[0]):
        total += particles.records[i]["radius"]
    return 2.0 * min(largest_radius(particles), 2.0 * total / particles.size[0])


@inlined_allocating
def count_overlaps(scene, particles, time):
    """Count the pairs that overlap by more than rounding at `time` in s.

    Spheres that fit into cells are compared within these, larger ones with all.
    """
    half = scene.half_width
    count, records = particles.size[0], particles.records
    most = int((2.0 * count) ** (1.0 / 3.0)) + 1
    edge = cell_edge(particles)
    cells = max(1, min(most, int(min(1e6, 2.0 * half / edge))))
    found = 0
    for i in range(count):
        if 2.0 * records[i]["radius"] > edge:
            for j in range(count):
                if 2.0 * records[j]["radius"] <= edge or j > i:
                    found += overlap(scene, records[i], records[j], time)
    order, start = sort_into_cells(particles, cells, half)
    for i in range(count):
        if 2.0 * records[i]["radius"] <= edge:
            found += overlaps_around(scene, records, cells, order, start, edge, i, time)
    return found


@inlined
def overlaps_around(scene, records, cells, order, start, edge, i, time):
    """Overlaps of sphere i with later ones in the cells around that fit into cells too."""
    shifts = int(image_offset(scene.escape, 1.0, time) * cells)
    a, b, c = cells_of(records[i], cells, scene.half_width)
    low, high = (-1, 1) if cells > 2 else (0, cells - 1)
    if cells <= 2:
        a, b, c = 0, 0, 0
    found = 0
    for q in range(b + low, b + high + 1):
        p0, p1 = columns_beside(scene.escape, q, a + low, a + high, cells, shifts)
        for p in range(p0, p1 + 1):
            layer = (wrapped_cell(p, cells) * cells + wrapped_cell(q, cells)) * cells
            for s in range(c + low, c + high + 1):
                cell = layer + wrapped_cell(s, cells)
                for k in range(start[cell], start[cell + 1]):
                    j = order[k]
                    if j > i and 2.0 * records[j]["radius"] <= edge:
                        found += overlap(scene, records[i], records[j], time)
    return found


@inlined
def overlap(scene, one, other, time):
    """1 if two spheres overlap by more than rounding at `time` in s, else 0."""
    limit = (one["radius"] + other["radius"]) * (1.0 - 1e-12)
    squared = squared_distance_at(scene, one, other, time)
    return 1 if squared < limit * limit else 0


@inlined
def squared_distance_at(scene, one, other, time):
    """Square in m² of the distance between two particles' centres at `time` in s."""
    if not is_sheared(scene.escape):
        return squared_distance(scene.escape, one, other, scene.half_width)
    side = 2.0 * scene.half_width
    images = np.rint((other["y"] - one["y"]) / side)
    x = other["x"] - one["x"] - images * image_offset(scene.escape, side, time)
    x = nearest_image(scene.escape, x, side, 1.0 / side)
    y, z = other["y"] - one["y"], other["z"] - one["z"]
    return square_of(scene.escape, x, y, z, scene.half_width)


@inlined
def radius_moments(particles, reference):
    """Mean of b/b⁰ and its central moments 2, 3, 4, dimensionless  [A 24]; `reference` b⁰ in m."""
    count = particles.size[0]
    mean = 0.0
    for i in range(count):
        mean += particles.records[i]["radius"] / reference
    mean /= count
    second, third, fourth = 0.0, 0.0, 0.0
    for i in range(count):
        deviation = particles.records[i]["radius"] / reference - mean
        second += deviation**2
        third += deviation**3
        fourth += deviation**4
    return mean, second / count, third / count, fourth / count


@inlined
def mean_temperature(scene, particles):
    """Mass-weighted mean temperature in K, kept between the extremes."""
    total, mass = 0.0, 0.0
    low, high = np.inf, 0.0
    for i in range(particles.size[0]):
        particle = particles.records[i]
        temperature = temperature_or(particle, scene.temperature)
        total += particle["mass"] * temperature
        mass += particle["mass"]
        low, high = min(low, temperature), max(high, temperature)
    return min(high, max(low, total / mass))


@inlined
def measure(scene, particles, time, out):
    """Write radii and temperature of the final state, at `time` in s, into the outcome record."""
    mean, second, third, fourth = radius_moments(particles, scene.radius)
    out["mean_radius_ratio"] = mean
    out["radius_moment_2"] = second
    out["radius_moment_3"] = third
    out["radius_moment_4"] = fourth
    out["mean_temperature"] = mean_temperature(scene, particles)
    out["particles"] = particles.size[0]
    out["overlaps"] = count_overlaps(scene, particles, time)


@inlined
def measure_initial(scene, particles, drift, initial):
    """Write the particles' momentum, energies and the drift of their frame into a record.

    Kinetic energy and sum of m|v| are in the centre-of-mass frame, heat is above the scene's
    temperature.
    """
    momentum, _ = total_momentum(scene.escape, particles)
    initial["begun"] = 1
    for axis in range(3):
        initial["drift"][axis] = drift[axis]
        initial["momentum"][axis] = momentum[axis]
    initial["energy"], initial["momentum_scale"] = mechanical_energy(
        scene.laws.friction, scene, particles
    )
    initial["heat"] = thermal_energy(scene.laws.heating, scene, particles)


@inlined
def measure_ledger(scene, particles, ledger, initial, out):
    """Write counts and closure errors into the outcome record.

    `initial` is what `measure_initial` wrote. With heat the first law is closed; without, kinetic
    energy against what impacts dissipate.
    """
    counts, energy = ledger.counts, ledger.energy
    out["steps"] = counts[STEPS]
    out["particle_steps"] = counts[PARTICLE_STEPS]
    out["collisions"] = counts[COLLISIONS]
    out["merges"] = counts[MERGES]
    out["breakups"] = counts[BREAKUPS]
    out["capped_iterations"] = counts[CAPPED]
    out["floored_temperatures"] = counts[FLOORED]
    out["largest_residual"] = ledger.residual[0]
    momentum, _ = total_momentum(scene.escape, particles)
    initial_energy, momentum_scale = initial["energy"], initial["momentum_scale"]
    square = 0.0
    for axis in range(3):
        square += (momentum[axis] - initial["momentum"][axis]) ** 2
    change = math.sqrt(square)
    out["momentum_error"] = change / momentum_scale if momentum_scale > 0.0 else change
    kinetic, _ = mechanical_energy(scene.laws.friction, scene, particles)
    balance = kinetic - initial_energy
    if is_sheared(scene.escape):
        balance -= energy[WORK]
    if scene.laws.heating is None:
        balance += energy[DISSIPATED]
    else:
        balance += thermal_energy(scene.laws.heating, scene, particles) - initial["heat"]
        balance += energy[RADIATED] + energy[SURFACE] + energy[UNRESOLVED] - energy[REACTION]
    flowed = initial_energy + energy[REACTION] + energy[EXCHANGED] + energy[SURFACE]
    if is_sheared(scene.escape):
        flowed += abs(energy[WORK])
    out["energy_error"] = balance / flowed if flowed > 0.0 else balance


@inlined
def is_finite(particles):
    """Whether every coordinate, velocity, radius, mass and temperature is finite."""
    total = 0.0
    for i in range(particles.size[0]):
        particle = particles.records[i]
        total += particle["radius"] + particle["mass"] + temperature_or(particle, 0.0)
        total += particle["x"] + particle["y"] + particle["z"]
        total += particle["u"] + particle["v"] + particle["w"]
    return math.isfinite(total)


def shear_account(scene: Any, particles: Any, ledger: Any) -> dict[str, float | int]:
    """Return what is reported of a sample in shear at its end; nothing of others.

    The work of the shear in J, and the kinetic energy in J of the motion about the mean flow.
    """
    if not is_sheared(scene.escape):
        return {}
    energy, _ = fluctuation_energy(scene.escape, particles)
    return {"shear_work": float(ledger.energy[WORK]), "fluctuation_energy": float(energy)}
