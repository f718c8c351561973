"""Pairs and laws for impact tests, and the impact equation written plainly in Python."""

import math

import numpy as np
from scipy.optimize import brentq

from agglom_mpi.physics.contact import CompressionRecoveryDuration, ContactArea, MeanSpeedDuration
from agglom_mpi.physics.friction import ConstantFriction, RestitutionScaledFriction
from agglom_mpi.physics.hardness import ArrheniusHardness, ConstantHardness
from agglom_mpi.physics.heating import OwnEnergy, PairSplit
from agglom_mpi.physics.impact_solvers import BracketedRoot
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.reaction import ContactAreaReaction
from agglom_mpi.physics.restitution import ConstantRestitution, ImpactLaws, PressureRestitution

R = 8.314462618
DENSITY = 5000.0


def contact_pair(
    w,
    slip=0.0,
    radii=(1e-3, 1e-3),
    temperatures=(300.0, 300.0),
    density=DENSITY,
    frame=(0.0, 0.0),
):
    """Return a pair of spheres; `frame` is the velocity of j along n and along t."""
    masses = [density * 4.0 / 3.0 * math.pi * radius**3 for radius in radii]
    return ContactPair(
        approach_speed=w,
        slip_speed=slip,
        mass_i=masses[0],
        mass_j=masses[1],
        reduced_mass=masses[0] * masses[1] / (masses[0] + masses[1]),
        radius=min(radii),
        radius_i=radii[0],
        radius_j=radii[1],
        temperature_i=temperatures[0],
        temperature_j=temperatures[1],
        normal_i=frame[0] + w,
        normal_j=frame[0],
        tangent_i=frame[1] + slip,
        tangent_j=frame[1],
    )


def isothermal_laws(duration, area, hardness=1e8, solver=None):
    return ImpactLaws(
        restitution=PressureRestitution.Numbers(),
        duration=duration,
        contact_area=area,
        hardness=ConstantHardness.Numbers(hardness),
        friction=None,
        heating=None,
        reaction=None,
        fragmentation=None,
        solver=solver or BracketedRoot.Numbers(),
        heat_capacity=math.inf,
    )


def laws_2003(hardness=6e7, energy=700.0, friction=0.3, heat=1e6, capacity=1000.0, initial=0.01):
    """Return the laws of [A] with its heat."""
    return ImpactLaws(
        restitution=PressureRestitution.Numbers(),
        duration=MeanSpeedDuration.Numbers(1e-6),
        contact_area=ContactArea.Numbers(initial, 1.0),
        hardness=ArrheniusHardness.Numbers(hardness, energy),
        friction=RestitutionScaledFriction.Numbers(friction),
        heating=PairSplit.Numbers(),
        reaction=ContactAreaReaction.Numbers(heat),
        fragmentation=None,
        solver=BracketedRoot.Numbers(),
        heat_capacity=capacity,
    )


def laws_2004(hardness=3e5, energy=300.0, friction=0.1, heat=1e6, capacity=1000.0, initial=0.0):
    """Return the laws of [B] with its own-energy heat."""
    return ImpactLaws(
        restitution=PressureRestitution.Numbers(),
        duration=CompressionRecoveryDuration.Numbers(1.0),
        contact_area=ContactArea.Numbers(initial, 1.0),
        hardness=ArrheniusHardness.Numbers(hardness, energy),
        friction=ConstantFriction.Numbers(friction),
        heating=OwnEnergy.Numbers(),
        reaction=ContactAreaReaction.Numbers(heat),
        fragmentation=None,
        solver=BracketedRoot.Numbers(),
        heat_capacity=capacity,
    )


def constant_laws(restitution, heating, friction):
    return ImpactLaws(
        restitution=ConstantRestitution.Numbers(restitution),
        duration=None,
        contact_area=ContactArea.Numbers(0.0, 1.0),
        hardness=None,
        friction=friction,
        heating=heating,
        reaction=None,
        fragmentation=None,
        solver=None,
        heat_capacity=1000.0,
    )


def pressure_scale(laws, pair):
    """X = I(e=0)/(2πb²H₀) of MODEL §2."""
    force = pair.reduced_mass * pair.approach_speed**2 / 2.0
    force /= laws.duration.length_ratio * pair.radius
    return force / (2.0 * math.pi * pair.radius**2 * laws.hardness.hardness)


def plain_heats(laws, pair, d):
    """Mechanical heat of both spheres at deficits d, an array [A 14–17] [B 6.5–6.10]."""
    e = 1.0 - d
    m, w, slip = pair.reduced_mass, pair.approach_speed, pair.slip_speed
    normal = m * (1.0 + e) * w
    coefficient = laws.friction.friction
    if isinstance(laws.friction, RestitutionScaledFriction.Numbers):
        coefficient = coefficient * d
    rubbing = np.minimum(coefficient * normal, m * slip)
    if isinstance(laws.heating, PairSplit.Numbers):
        loss = 0.5 * m * w * w * d * (1.0 + e) + slip * rubbing - rubbing**2 / (2.0 * m)
        return 0.5 * loss, 0.5 * loss
    work = m * w * w * d * (1.0 + e) / 3.0
    own_i = pair.normal_i * normal + pair.tangent_i * rubbing
    own_i = own_i - (normal**2 + rubbing**2) / (2.0 * pair.mass_i)
    own_j = -pair.normal_j * normal - pair.tangent_j * rubbing
    own_j = own_j - (normal**2 + rubbing**2) / (2.0 * pair.mass_j)
    return own_i + work, own_j + work


def plain_log_ratio(laws, pair, d):
    """ln of I/(2 a^c H) at deficits d, an array; the impact equation is ln r(d) = ln d."""
    d = np.asarray(d, dtype=float)
    e = 1.0 - d
    m, w, b = pair.reduced_mass, pair.approach_speed, pair.radius
    log_force = math.log(m) + 2.0 * math.log(w) - math.log(2.0 * laws.duration.length_ratio * b)
    if isinstance(laws.duration, MeanSpeedDuration.Numbers):
        log_force = log_force + 2.0 * np.log1p(e)
    span = laws.contact_area.final - laws.contact_area.initial
    area = (laws.contact_area.initial + span * d) * math.pi * b * b
    heats = plain_heats(laws, pair, d)
    reaction = laws.reaction.reaction_heat * area
    temperatures = [
        before + (heat + reaction) / (mass * laws.heat_capacity)
        for before, heat, mass in zip(
            (pair.temperature_i, pair.temperature_j), heats, (pair.mass_i, pair.mass_j), strict=True
        )
    ]
    warmest = np.maximum(*temperatures)
    with np.errstate(divide="ignore"):
        hardening = np.where(
            warmest > 0.0, laws.hardness.activation_energy / (R * np.abs(warmest)), np.inf
        )
    return log_force - np.log(2.0 * area) - math.log(laws.hardness.hardness) - hardening


def scanned_root(laws, pair, lowest=-60.0, points=60_001):
    """Largest root in ln d by a dense scan from d = 1 down; None if the pair bonds, or no root."""
    grid = np.linspace(0.0, lowest, points)
    excess = plain_log_ratio(laws, pair, np.exp(grid)) - grid
    if excess[0] >= 0.0:
        return None
    crossed = np.flatnonzero(excess >= 0.0)
    if len(crossed) == 0:
        return -math.inf
    k = crossed[0]

    def difference(x):
        return float(plain_log_ratio(laws, pair, np.exp(x)) - x)

    if not math.isfinite(excess[k - 1]) or not math.isfinite(excess[k]):
        return float(grid[k])
    return brentq(difference, grid[k], grid[k - 1], xtol=1e-15, rtol=8.9e-16)
