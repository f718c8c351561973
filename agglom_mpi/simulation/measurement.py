"""Quantities that are measured of a sample."""

import math

import numpy as np

from agglom_mpi.compilation.stages import inlined, inlined_allocating
from agglom_mpi.simulation.boundary import (
    cells_of,
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
    largest_radius,
    temperature_or,
)
from agglom_mpi.simulation.reference_frame import total_momentum
from agglom_mpi.simulation.spins import mechanical_energy
from agglom_mpi.simulation.time_driven.neighbours import squared_distance


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
def count_overlaps(scene, particles):
    """Count the pairs that overlap by more than rounding.

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
                    found += overlap(scene, records[i], records[j])
    order, start = sort_into_cells(particles, cells, half)
    for i in range(count):
        if 2.0 * records[i]["radius"] <= edge:
            found += overlaps_around(scene, records, cells, order, start, edge, i)
    return found


@inlined
def overlaps_around(scene, records, cells, order, start, edge, i):
    """Overlaps of sphere i with later ones in the cells around that fit into cells too."""
    a, b, c = cells_of(records[i], cells, scene.half_width)
    low, high = (-1, 1) if cells > 2 else (0, cells - 1)
    if cells <= 2:
        a, b, c = 0, 0, 0
    found = 0
    for p in range(a + low, a + high + 1):
        for q in range(b + low, b + high + 1):
            layer = (wrapped_cell(p, cells) * cells + wrapped_cell(q, cells)) * cells
            for s in range(c + low, c + high + 1):
                cell = layer + wrapped_cell(s, cells)
                for k in range(start[cell], start[cell + 1]):
                    j = order[k]
                    if j > i and 2.0 * records[j]["radius"] <= edge:
                        found += overlap(scene, records[i], records[j])
    return found


@inlined
def overlap(scene, one, other):
    """1 if two spheres overlap by more than rounding, else 0."""
    limit = (one["radius"] + other["radius"]) * (1.0 - 1e-12)
    squared = squared_distance(scene.escape, one, other, scene.half_width)
    return 1 if squared < limit * limit else 0


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
def measure(scene, particles, out):
    """Write radii and temperature of the final state into the outcome record."""
    mean, second, third, fourth = radius_moments(particles, scene.radius)
    out["mean_radius_ratio"] = mean
    out["radius_moment_2"] = second
    out["radius_moment_3"] = third
    out["radius_moment_4"] = fourth
    out["mean_temperature"] = mean_temperature(scene, particles)
    out["particles"] = particles.size[0]
    out["overlaps"] = count_overlaps(scene, particles)


@inlined
def measure_initial(scene, particles, drift, initial):
    """Write the particles' momentum, energies and the drift of their frame into a record.

    Kinetic energy and sum of m|v| are in the centre-of-mass frame, heat is above the scene's
    temperature.
    """
    momentum, _ = total_momentum(particles)
    initial["begun"] = 1
    for axis in range(3):
        initial["drift"][axis] = drift[axis]
        initial["momentum"][axis] = momentum[axis]
    initial["energy"], initial["momentum_scale"] = mechanical_energy(scene.laws.friction, particles)
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
    momentum, _ = total_momentum(particles)
    initial_energy, momentum_scale = initial["energy"], initial["momentum_scale"]
    square = 0.0
    for axis in range(3):
        square += (momentum[axis] - initial["momentum"][axis]) ** 2
    change = math.sqrt(square)
    out["momentum_error"] = change / momentum_scale if momentum_scale > 0.0 else change
    kinetic, _ = mechanical_energy(scene.laws.friction, particles)
    balance = kinetic - initial_energy
    if scene.laws.heating is None:
        balance += energy[DISSIPATED]
    else:
        balance += thermal_energy(scene.laws.heating, scene, particles) - initial["heat"]
        balance += energy[RADIATED] + energy[SURFACE] + energy[UNRESOLVED] - energy[REACTION]
    flowed = initial_energy + energy[REACTION] + energy[EXCHANGED] + energy[SURFACE]
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
