"""Spins of rough grains: slip of the surfaces, what an impact turns, merging, breaking, energy.

Each stage is chosen by the law of friction when a kernel is compiled, and does nothing in a scene
whose grains do not spin. Other particles have an angular velocity in rad/s and the moment of
inertia (2/5)mr² of a solid sphere.

An event that changes shapes conserves angular momentum as far as energy allows: two grains that
become one compact sphere have less inertia. Where the rotation would need more energy than there
is, it takes all of that, and the rest of the angular momentum is left to the structure, in the
ledger.
"""

import math
from typing import Any, Final

from agglom_mpi.compilation.stages import ANY, dispatch, inlined
from agglom_mpi.outcome import SPIN_UNITS
from agglom_mpi.physics.rough import INERTIA, SpinningFriction
from agglom_mpi.simulation.impact import ImpactResult
from agglom_mpi.simulation.particles import (
    DISSIPATED,
    LEFT_TO_STRUCTURE,
    SPIN_CAPS,
    set_spin,
    set_velocity,
    spin_of,
    velocity_of,
)
from agglom_mpi.simulation.reference_frame import (
    fluctuation_energy,
    motion_energy,
    total_momentum,
)
from agglom_mpi.simulation.temperature import add_heat
from agglom_mpi.simulation.vectors import (
    cross,
    dot,
    relative_velocity,
    scaled,
    separation_vector,
    sum_of,
)

PARTING: Final = 1e-8
"""Speed at which pieces part, over that of their rotation about their common centre.

Rounding lets no two of them approach each other then; its energy is below the last digit.
"""


@inlined
def inertia_of(particle):
    """Moment of inertia in kg m² of a solid sphere."""
    return INERTIA * particle["mass"] * particle["radius"] * particle["radius"]


@inlined
def spin_energy(particle):
    """Kinetic energy in J of the rotation of a particle."""
    spin = spin_of(particle)
    return 0.5 * inertia_of(particle) * dot(spin, spin)


@inlined
def distance_over_radii(scene, one, other):
    """Distance of two centres over the sum of both radii, below 1 where they overlap."""
    line = separation_vector(scene.escape, one, other, scene.half_width)
    return math.sqrt(dot(line, line)) / (one["radius"] + other["radius"])


@dispatch
def surface_velocity(friction, scene, one, other, normal, velocity):
    """Velocity in m/s of the surface of one particle relative to the other's, where they touch.

    `velocity` is that of the centres; where these do not spin it is the same.
    """


@surface_velocity.register(None, ANY)
def _of_centres(friction, scene, one, other, normal, velocity):
    return velocity


@surface_velocity.register(SpinningFriction)
def _of_surfaces(friction, scene, one, other, normal, velocity):
    # The point of contact divides an overlap, so that an impulse there has no torque on the pair.
    share = distance_over_radii(scene, one, other)
    turning = sum_of(scaled(spin_of(one), one["radius"]), other["radius"], spin_of(other))
    return sum_of(velocity, share, cross(turning, normal))


@dispatch
def turn_pair(friction, scene, one, other, pair, impact, normal, tangent):
    """Turn both particles by the tangential impulse of a bounce; return the impact.

    Where they overlap their levers are shorter, and the impact dissipates more: ½P²(1 − s²) 5/2m*.
    """


@turn_pair.register(None, ANY)
def _turn_nothing(friction, scene, one, other, pair, impact, normal, tangent):
    return impact


@turn_pair.register(SpinningFriction)
def _turn_both(friction, scene, one, other, pair, impact, normal, tangent):
    impulse = impact.friction_impulse
    share = distance_over_radii(scene, one, other)
    torque = scaled(cross(normal, tangent), -share * impulse)
    set_spin(one, sum_of(spin_of(one), one["radius"] / inertia_of(one), torque))
    set_spin(other, sum_of(spin_of(other), other["radius"] / inertia_of(other), torque))
    further = 0.5 * impulse * impulse * (1.0 - share * share) / (INERTIA * pair.reduced_mass)
    return ImpactResult(
        impact.bonds,
        impact.deficit,
        impact.normal_impulse,
        impulse,
        impact.heat_i + 0.5 * further,
        impact.heat_j + 0.5 * further,
        impact.reaction,
        impact.loss + further,
        impact.residual,
        impact.capped,
    )


@inlined
def allowed_rotation(ledger, momentum, needed, available):
    """Fraction of an angular momentum in J s that the energy in J allows; the rest is entered.

    `needed` is the energy in J of the rotation that has all of it.
    """
    if needed <= available:
        return 1.0
    fraction = math.sqrt(available / needed)
    ledger.counts[SPIN_CAPS] += 1
    for axis in range(3):
        ledger.energy[LEFT_TO_STRUCTURE + axis] += (1.0 - fraction) * momentum[axis]
    return fraction


@dispatch
def pair_rotation(friction, one, other, line, reduced_mass):
    """Angular momentum in J s of a pair that merges, its energy in J, and that of both spins in J.

    The momentum is about the common centre, the energy that of motion relative to it; `line` in m
    leads from one to the other.
    """


@pair_rotation.register(None, ANY)
def _no_rotation(friction, one, other, line, reduced_mass):
    return None


@pair_rotation.register(SpinningFriction)
def _rotation_of_both(friction, one, other, line, reduced_mass):
    velocity = relative_velocity(one, other)
    spins = sum_of(scaled(spin_of(one), inertia_of(one)), inertia_of(other), spin_of(other))
    # −line leads from the other to the one, whose velocity relative to the other this is.
    momentum = sum_of(spins, -reduced_mass, cross(line, velocity))
    turning = spin_energy(one) + spin_energy(other)
    return momentum, turning + 0.5 * reduced_mass * dot(velocity, velocity), turning


@dispatch
def spin_merged(friction, scene, particle, ledger, rotation):
    """Give a particle that has formed the `rotation` of `pair_rotation`, as far as it is allowed.

    Heats it by what spins lose beside the relative motion of the centres.
    """


@spin_merged.register(None, ANY)
def _merge_without_spin(friction, scene, particle, ledger, rotation):
    return None


@spin_merged.register(SpinningFriction)
def _merge_spins(friction, scene, particle, ledger, rotation):
    momentum, available, turning = rotation
    inertia = inertia_of(particle)
    needed = 0.5 * dot(momentum, momentum) / inertia
    fraction = allowed_rotation(ledger, momentum, needed, available)
    set_spin(particle, scaled(momentum, fraction / inertia))
    released = turning - spin_energy(particle)
    ledger.energy[DISSIPATED] += released
    add_heat(scene.laws.heating, scene, particle, ledger, released)


@dispatch
def turn_pieces(friction, scene, particles, ledger, i, first, sites, given):
    """Let the pieces of a broken particle rotate together, about their centre, with its momentum.

    They are particle i and those from slot `first` on, at the `sites` in m, shape (3, pieces), with
    the spin of the whole. `given` is the energy in J that the impact leaves beside the rotation.
    """


@turn_pieces.register(None, ANY)
def _pieces_do_not_spin(friction, scene, particles, ledger, i, first, sites, given):
    return None


@turn_pieces.register(SpinningFriction)
def _rotate_pieces(friction, scene, particles, ledger, i, first, sites, given):
    piece, count = particles.records[i], sites.shape[1]
    spin, mass = spin_of(piece), piece["mass"]
    # All pieces have the volume of the whole, whose radius is count^⅓ times theirs.
    momentum = scaled(spin, inertia_of(piece) * count * count ** (2.0 / 3.0))
    before = 0.5 * dot(momentum, spin)
    rotation = rotation_of_pieces(momentum, sites, mass, count * inertia_of(piece))
    needed = 0.5 * dot(momentum, rotation)
    fraction = allowed_rotation(ledger, momentum, needed, before + max(0.0, given))
    rotation = scaled(rotation, fraction)
    released = before - fraction * fraction * needed
    ledger.energy[DISSIPATED] += released
    parting = PARTING * math.sqrt(dot(rotation, rotation))
    for k in range(count):
        piece = particles.records[i if k == 0 else first + k - 1]
        site = sites[0, k], sites[1, k], sites[2, k]
        velocity = sum_of(velocity_of(piece), 1.0, cross(rotation, site))
        set_velocity(piece, sum_of(velocity, parting, site))
        set_spin(piece, rotation)
        add_heat(scene.laws.heating, scene, piece, ledger, released / count)


@inlined
def rotation_of_pieces(momentum, sites, mass, own):
    """Angular velocity in rad/s with which pieces rotate as one body that has a momentum in J s.

    `mass` is that of a piece in kg, `own` the inertia in kg m² of all of them about their centres.
    """
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(sites.shape[1]):
        x, y, z = sites[0, k], sites[1, k], sites[2, k]
        xx += mass * x * x
        yy += mass * y * y
        zz += mass * z * z
        xy += mass * x * y
        xz += mass * x * z
        yz += mass * y * z
    a = own + yy + zz, -xy, -xz
    b = -xy, own + xx + zz, -yz
    c = -xz, -yz, own + xx + yy
    # The tensor of inertia is symmetric: its inverse has the vector products of its rows as rows.
    ab, bc, ca = cross(a, b), cross(b, c), cross(c, a)
    volume = dot(a, bc)
    return dot(bc, momentum) / volume, dot(ca, momentum) / volume, dot(ab, momentum) / volume


@dispatch
def rotational_energy(friction, particles):
    """Kinetic energy in J of the rotation of all particles; 0 where they do not spin."""


@rotational_energy.register(None, ANY)
def _no_rotational_energy(friction, particles):
    return 0.0


@rotational_energy.register(SpinningFriction)
def _sum_of_spin_energies(friction, particles):
    energy = 0.0
    for i in range(particles.size[0]):
        energy += spin_energy(particles.records[i])
    return energy


@dispatch
def mechanical_energy(friction, scene, particles):
    """Kinetic energy in J, that of spins included, and sum of m|v|, in the centre-of-mass frame.

    Where the box is sheared, both have the mean flow in them.
    """


@mechanical_energy.register(None, ANY)
def _of_motion_alone(friction, scene, particles):
    return motion_energy(scene.escape, particles)


@mechanical_energy.register(SpinningFriction)
def _of_motion_and_spins(friction, scene, particles):
    energy, momentum_scale = motion_energy(scene.escape, particles)
    return energy + rotational_energy(friction, particles), momentum_scale


@dispatch
def draw_spins(friction, escape, random, particles):
    """Draw the spins of grains that have their velocities; nothing where they start without.

    Components are uniform, √(1/I) wide, and scaled so that the rotational temperature of the sample
    is `spin_temperature` times its translational one.
    """


@draw_spins.register(None, ANY)
def _draw_nothing(friction, escape, random, particles):
    return None


@draw_spins.register(SpinningFriction)
def _draw_uniformly(friction, escape, random, particles):
    if friction.spin_temperature == 0.0:
        return
    for i in range(particles.size[0]):
        grain = particles.records[i]
        width = 2.0 / math.sqrt(inertia_of(grain))
        p, q = random.random() - 0.5, random.random() - 0.5
        set_spin(grain, (width * p, width * q, width * (random.random() - 0.5)))
    motion, _ = fluctuation_energy(escape, particles)
    wanted = friction.spin_temperature * motion
    factor = math.sqrt(wanted / rotational_energy(friction, particles))
    for i in range(particles.size[0]):
        grain = particles.records[i]
        set_spin(grain, scaled(spin_of(grain), factor))


@dispatch
def measure_spins(friction, escape, particles, ledger, out):
    """Write `SPIN_COLUMNS` into the outcome record; nothing where none spins."""


@measure_spins.register(None, ANY)
def _measure_nothing(friction, escape, particles, ledger, out):
    return None


@measure_spins.register(SpinningFriction)
def _measure_temperatures(friction, escape, particles, ledger, out):
    _, mass = total_momentum(escape, particles)
    motion, _ = fluctuation_energy(escape, particles)
    left = ledger.energy[LEFT_TO_STRUCTURE : LEFT_TO_STRUCTURE + 3]
    out["granular_temperature"] = 2.0 * motion / (3.0 * mass)
    out["rotational_temperature"] = 2.0 * rotational_energy(friction, particles) / (3.0 * mass)
    out["spin_caps"] = ledger.counts[SPIN_CAPS]
    out["angular_momentum_left"] = math.sqrt(left[0] ** 2 + left[1] ** 2 + left[2] ** 2)


def spin_account(record: Any) -> dict[str, float | int]:
    """Return what is reported of the spins of a sample by its record; nothing where none spins.

    The ratio of the temperatures is nan where nothing moves.
    """
    if SPIN_UNITS.keys().isdisjoint(record.dtype.names):
        return {}
    motion, turning = record["granular_temperature"], record["rotational_temperature"]
    return {
        "rotational_ratio": float(turning / motion) if motion > 0.0 else math.nan,
        "spin_caps": int(record["spin_caps"]),
        "angular_momentum_left": float(record["angular_momentum_left"]),
    }
