"""What a contact does to the particles: bounce, bond or break, entered in the ledger."""

import math
from typing import Final

import numpy as np

from agglom_mpi.compilation.stages import ANY, dispatch, inlined, inlined_allocating
from agglom_mpi.physics.contact import contact_area
from agglom_mpi.physics.fragmentation import breakage
from agglom_mpi.physics.heating import (
    merge_dissipation,
    merge_heat,
    own_energy_loss,
)
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.reaction import contact_heat
from agglom_mpi.simulation.boundary import wrapped_position
from agglom_mpi.simulation.impact import solve_impact
from agglom_mpi.simulation.particles import (
    BREAKUPS,
    CAPPED,
    COLLISIONS,
    DISSIPATED,
    MERGES,
    REACTION,
    SURFACE,
    copy_slot,
    empty_slot,
    grains_or,
    last_impact_or,
    moved_by,
    new_label,
    position_of,
    set_grains,
    set_last_impact,
    set_position,
    set_temperature,
    temperature_or,
    velocity_of,
)
from agglom_mpi.simulation.spins import (
    pair_rotation,
    spin_merged,
    surface_velocity,
    turn_pair,
    turn_pieces,
)
from agglom_mpi.simulation.temperature import add_heat, cool_until
from agglom_mpi.simulation.vectors import dot, relative_velocity, scaled, separation_vector

RECEDING: Final = 0
BOUNCED: Final = 1
BONDED: Final = 2


@inlined
def line_of_centres(scene, one, other):
    """Return the unit vector from one to the other; where centres coincide, of the velocity."""
    line = separation_vector(scene.escape, one, other, scene.half_width)
    length = math.sqrt(dot(line, line))
    if length == 0.0:
        line = relative_velocity(one, other)
        length = math.sqrt(dot(line, line))
    return scaled(line, 1.0 / length) if length > 0.0 else (1.0, 0.0, 0.0)


@inlined
def slip_direction(normal, velocity, approach):
    """Slip speed |u_t| in m/s and its unit vector; the vector is zero without slip."""
    slip = (
        velocity[0] - approach * normal[0],
        velocity[1] - approach * normal[1],
        velocity[2] - approach * normal[2],
    )
    speed = math.sqrt(dot(slip, slip))
    return speed, scaled(slip, 1.0 / speed) if speed > 0.0 else (0.0, 0.0, 0.0)


@inlined
def contact_pair(friction, scene, one, other, ledger, normal, time):
    """Pair at contact with temperatures at `time` in s, and the unit vector of its slip.

    The slip is that of the surfaces, or of the centres without a law of `friction`.

    Cools both particles up to `time` first, where the scene cools exactly.
    """
    cool_until(scene.cooling, scene, one, ledger, time)
    cool_until(scene.cooling, scene, other, ledger, time)
    velocity = relative_velocity(one, other)
    approach = dot(velocity, normal)
    surfaces = surface_velocity(friction, scene, one, other, normal, velocity)
    slip, tangent = slip_direction(normal, surfaces, approach)
    velocity_i, velocity_j = velocity_of(one), velocity_of(other)
    mass_i, mass_j = one["mass"], other["mass"]
    pair = ContactPair(
        approach,
        slip,
        mass_i,
        mass_j,
        mass_i * mass_j / (mass_i + mass_j),
        min(one["radius"], other["radius"]),
        one["radius"],
        other["radius"],
        temperature_or(one, scene.temperature),
        temperature_or(other, scene.temperature),
        dot(velocity_i, normal),
        dot(velocity_j, normal),
        dot(velocity_i, tangent),
        dot(velocity_j, tangent),
        time - max(last_impact_or(one, -np.inf), last_impact_or(other, -np.inf)),
    )
    return pair, tangent


@inlined
def resolve_contact(scene, particles, ledger, i, j, time):
    """Resolve a contact at `time` in s; the caller carries out a merge.

    Returns `RECEDING` (no contact), `BOUNCED` or `BONDED`. Fragments are appended. Only approaching
    pairs are in contact: aggregates overlap when they form.
    """
    one, other = particles.records[i], particles.records[j]
    normal = line_of_centres(scene, one, other)
    if not dot(relative_velocity(one, other), normal) > 0.0:
        return RECEDING
    friction = scene.laws.friction
    pair, tangent = contact_pair(friction, scene, one, other, ledger, normal, time)
    set_last_impact(one, time)
    set_last_impact(other, time)
    impact = solve_impact(scene.laws, pair)
    if impact.bonds:
        return BONDED
    impact = turn_pair(friction, scene, one, other, pair, impact, normal, tangent)
    record_impact(ledger, impact)
    impulse = impulse_of(friction, impact, normal, tangent)
    apply_impulse(one, -1.0 / pair.mass_i, impulse)
    apply_impulse(other, 1.0 / pair.mass_j, impulse)
    apply_impact(scene, particles, ledger, i, pair.normal_i, pair.tangent_i, impact, impact.heat_i)
    apply_impact(
        scene, particles, ledger, j, -pair.normal_j, -pair.tangent_j, impact, impact.heat_j
    )
    return BOUNCED


@inlined
def record_impact(ledger, impact):
    """Enter a bounce in the ledger; what is always 0 in a scene compiles to nothing."""
    ledger.counts[COLLISIONS] += 1
    ledger.energy[DISSIPATED] += impact.loss
    if impact.reaction != 0.0:
        ledger.energy[REACTION] += impact.reaction
    if impact.residual != 0.0:
        ledger.residual[0] = max(ledger.residual[0], impact.residual)
    if impact.capped:
        ledger.counts[CAPPED] += 1


@dispatch
def impulse_of(friction, impact, normal, tangent):
    """Impulse in N s, three components, that acts on j and against i."""


@impulse_of.register(None)
def _along_normal(friction, impact, normal, tangent):
    return scaled(normal, impact.normal_impulse)


@impulse_of.register(ANY)
def _with_friction(friction, impact, normal, tangent):
    along_n, along_t = impact.normal_impulse, impact.friction_impulse
    return (
        along_n * normal[0] + along_t * tangent[0],
        along_n * normal[1] + along_t * tangent[1],
        along_n * normal[2] + along_t * tangent[2],
    )


@inlined
def apply_impulse(particle, factor, impulse):
    """Change the velocity of a particle by an impulse in N s times `factor` ±1/m in 1/kg."""
    particle["u"] += factor * impulse[0]
    particle["v"] += factor * impulse[1]
    particle["w"] += factor * impulse[2]


@inlined
def apply_impact(scene, particles, ledger, i, normal_speed, tangent_speed, impact, heat):
    """Heat particle i after a bounce, and break it if the energy it absorbed suffices.

    The surface energy of the fragments comes out of its heat  [B 6.5–6.10].
    """
    particle = particles.records[i]
    change = own_energy_loss(
        particle["mass"],
        normal_speed,
        tangent_speed,
        impact.normal_impulse,
        impact.friction_impulse,
    )
    pieces, energy = breakage(
        scene.laws.fragmentation, impact.loss, change, particle["radius"], grains_or(particle, 1)
    )
    add_heat(scene.laws.heating, scene, particle, ledger, heat - energy)
    given = 0.5 * impact.loss - energy
    fragment(scene.laws.fragmentation, scene, particles, ledger, i, pieces, energy, given)


@dispatch
def fragment(model, scene, particles, ledger, i, pieces, energy, given):
    """Break particle i into `pieces` for a surface energy in J; nothing without fragmentation.

    `given` is what that leaves in J of the loss of the impact, for pieces that rotate.
    """


@fragment.register(None)
def _unbreakable(model, scene, particles, ledger, i, pieces, energy, given):
    return None


@fragment.register(ANY)
def _break(model, scene, particles, ledger, i, pieces, energy, given):
    if pieces > 1:
        ledger.counts[BREAKUPS] += 1
        ledger.energy[SURFACE] += energy
        split_particle(scene, particles, ledger, i, pieces, given)


@inlined_allocating
def split_particle(scene, particles, ledger, i, pieces, given):
    """Replace particle i by equal pieces at its velocity, packed around its centre of mass.

    If it spins they rotate together, and may take the energy `given` in J.

    The first piece keeps slot and label, the others are appended. Grains are shared out as evenly
    as whole numbers allow.
    """
    whole = particles.records[i]
    grains, centre = whole["grains"], position_of(whole)
    whole["mass"] /= pieces
    whole["radius"] /= pieces ** (1.0 / 3.0)
    sites, first = packed_sites(pieces, whole["radius"]), particles.size[0]
    for k in range(pieces):
        slot = i
        if k > 0:
            slot = particles.size[0]
            particles.size[0] += 1
            copy_slot(particles, i, slot)
            new_label(particles, slot)
        piece = particles.records[slot]
        moved = (centre[0] + sites[0, k], centre[1] + sites[1, k], centre[2] + sites[2, k])
        set_position(piece, wrapped_position(scene, moved))
        piece["grains"] = grains // pieces + (1 if k < grains % pieces else 0)
    turn_pieces(scene.laws.friction, scene, particles, ledger, i, first, sites, given)


@inlined_allocating
def packed_sites(count, radius):
    """Sites in m of touching equal spheres around their centre of mass, shape (3, count).

    The `count` sites of a face-centred cubic lattice that are nearest to one of its sites.
    """
    sites = np.empty((3, count))
    unit = math.sqrt(2.0) * radius
    found = 0
    shell = 0
    while found < count:
        reach = int(math.sqrt(shell)) + 1
        for a in range(-reach, reach + 1):
            for b in range(-reach, reach + 1):
                for c in range(-reach, reach + 1):
                    if a * a + b * b + c * c == shell and found < count:
                        sites[0, found] = unit * a
                        sites[1, found] = unit * b
                        sites[2, found] = unit * c
                        found += 1
        shell += 2
    for axis in range(3):
        total = 0.0
        for piece in range(count):
            total += sites[axis, piece]
        for piece in range(count):
            sites[axis, piece] -= total / count
    return sites


@inlined
def merged_radius(first, second):
    """Radius of the sphere of both volumes, in any unit of length to the bit."""
    larger = max(first, second)
    return larger * (1.0 + (min(first, second) / larger) ** 3) ** (1.0 / 3.0)


@inlined
def merge(scene, particles, ledger, i, j, time):
    """Bond particle j to particle i at `time` in s: mass, volume, momentum, heat; empty slot j.

    At the centre of mass, with the total momentum, and the angular momentum if they spin; heat of
    the dissipated energy, the reaction, and what mixing both temperatures leaves by rounding.
    """
    one, other = particles.records[i], particles.records[j]
    normal = line_of_centres(scene, one, other)
    pair, _ = contact_pair(None, scene, one, other, ledger, normal, time)
    line = separation_vector(scene.escape, one, other, scene.half_width)
    mass = pair.mass_i + pair.mass_j
    share = pair.mass_j / mass
    laws = scene.laws
    rotation = pair_rotation(laws.friction, one, other, line, pair.reduced_mass)
    area = contact_area(laws.contact_area, 1.0, pair.radius)
    reaction = 2.0 * contact_heat(laws.reaction, area)
    ledger.counts[COLLISIONS] += 1
    ledger.counts[MERGES] += 1
    ledger.energy[REACTION] += reaction
    ledger.energy[DISSIPATED] += merge_dissipation(pair)
    set_position(one, wrapped_position(scene, moved_by(one, share, line)))
    one["u"] = (pair.mass_i * one["u"] + pair.mass_j * other["u"]) / mass
    one["v"] = (pair.mass_i * one["v"] + pair.mass_j * other["v"]) / mass
    one["w"] = (pair.mass_i * one["w"] + pair.mass_j * other["w"]) / mass
    # Both have the same heat capacity per mass: the mean by mass, and what its rounding loses.
    mixed = pair.temperature_i + share * (pair.temperature_j - pair.temperature_i)
    set_temperature(one, mixed)
    remainder = pair.mass_i * (pair.temperature_i - mixed) + pair.mass_j * (
        pair.temperature_j - mixed
    )
    one["radius"] = merged_radius(one["radius"], other["radius"])
    one["mass"] = mass
    set_grains(one, grains_or(one, 1) + grains_or(other, 1))
    empty_slot(particles, j)
    heat = merge_heat(laws.heating, pair) + reaction + remainder * laws.heat_capacity
    add_heat(laws.heating, scene, one, ledger, heat)
    spin_merged(laws.friction, scene, one, ledger, rotation)
