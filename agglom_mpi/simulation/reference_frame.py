"""The frame of reference of a simulation.

It is the centre of mass, unless a law of the scene depends on the frame: a drifting cloud would
cross cells for nothing, and a drift a million times the other velocities would take six digits
from them.
"""

import math

from agglom_mpi.compilation.stages import inlined
from agglom_mpi.declaration.laws import is_frame_dependent
from agglom_mpi.simulation.boundary import flow_speed, is_sheared, wrapped_position
from agglom_mpi.simulation.particles import moved_by, set_position, velocity_of
from agglom_mpi.simulation.shear import put_into_box


@inlined
def to_mass_frame(scene, particles):
    """Change to the centre-of-mass frame if no law depends on the frame.

    Returns the velocity of that frame in m/s, three components; 0 if it was not changed.
    """
    laws = scene.laws
    if is_frame_dependent(scene.engine) or is_frame_dependent(scene.escape):
        return 0.0, 0.0, 0.0
    if is_frame_dependent(laws.heating) or is_frame_dependent(laws.fragmentation):
        return 0.0, 0.0, 0.0
    momentum, mass = total_momentum(scene.escape, particles)
    drift = (momentum[0] / mass, momentum[1] / mass, momentum[2] / mass)
    for i in range(particles.size[0]):
        particle = particles.records[i]
        particle["u"] -= drift[0]
        particle["v"] -= drift[1]
        particle["w"] -= drift[2]
    return drift


@inlined
def to_box_frame(scene, particles, drift, time):
    """Return to the frame of the box after `time` in s.

    All move by the same rounded displacement, so that neighbours stay apart after a million boxes.
    """
    if drift[0] == 0.0 and drift[1] == 0.0 and drift[2] == 0.0:
        return
    shift = wrapped_position(scene, (drift[0] * time, drift[1] * time, drift[2] * time))
    for i in range(particles.size[0]):
        particle = particles.records[i]
        particle["u"] += drift[0]
        particle["v"] += drift[1]
        particle["w"] += drift[2]
        set_position(particle, wrapped_position(scene, moved_by(particle, 1.0, shift)))
        put_into_box(scene, particle, None, time)


@inlined
def velocity_about_flow(escape, particle):
    """Velocity of a particle about the mean flow at its place in m/s, three components."""
    u, v, w = velocity_of(particle)
    return (u - flow_speed(escape, particle["y"]) if is_sheared(escape) else u), v, w


@inlined
def total_momentum(escape, particles):
    """Momentum about the mean flow in kg m/s, three components, and mass in kg."""
    mass, x, y, z = 0.0, 0.0, 0.0, 0.0
    for i in range(particles.size[0]):
        particle = particles.records[i]
        u, v, w = velocity_about_flow(escape, particle)
        mass += particle["mass"]
        x += particle["mass"] * u
        y += particle["mass"] * v
        z += particle["mass"] * w
    return (x, y, z), mass


@inlined
def fluctuation_energy(escape, particles):
    """Kinetic energy in J and sum of m|v| in kg m/s, about the mean flow and the mean velocity."""
    momentum, mass = total_momentum(escape, particles)
    mean_u, mean_v, mean_w = momentum[0] / mass, momentum[1] / mass, momentum[2] / mass
    energy, momentum_scale = 0.0, 0.0
    for i in range(particles.size[0]):
        particle = particles.records[i]
        u, v, w = velocity_about_flow(escape, particle)
        square = (u - mean_u) ** 2
        square += (v - mean_v) ** 2
        square += (w - mean_w) ** 2
        energy += 0.5 * particle["mass"] * square
        momentum_scale += particle["mass"] * math.sqrt(square)
    return energy, momentum_scale


@inlined
def motion_energy(escape, particles):
    """`fluctuation_energy`; where the box is sheared, both have the mean flow in them.

    That energy is conserved between changes of images, whereas the flow feeds fluctuations all
    along; and momentum is kept to the rounding of such velocities.
    """
    if not is_sheared(escape):
        return fluctuation_energy(escape, particles)
    energy, momentum_scale = 0.0, 0.0
    for i in range(particles.size[0]):
        particle = particles.records[i]
        u, v, w = velocity_of(particle)
        square = u * u + v * v + w * w
        energy += 0.5 * particle["mass"] * square
        momentum_scale += particle["mass"] * math.sqrt(square)
    return energy, momentum_scale
