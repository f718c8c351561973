"""Scales of a scene for one parameter string: size and mass of a grain, box, end time, collisions.

Where grains have different sizes, b⁰ is their mean radius, and the mass is that of a grain of it.
Values that float64 cannot calculate with are refused.
"""

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from agglom_mpi.physics.kinetic_theory import enskog_rate, mean_free_path, mixture_rates
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.size_distributions import SizeLaw, size_classes

LIGHTEST: Final = 1e-100
HEAVIEST: Final = 1e100
"""Masses of a grain in kg whose products, those of aggregates too, are numbers in float64."""

LARGEST_EXPONENT: Final = 600.0
"""U/(Rθ) beyond which the hardness, and so the critical speed, is no number any more."""


def half_width(scene: Any, value: Mapping[str, float]) -> float:
    """Return half the edge of the box D in m: the scene's, or b⁰ N^⅓/ℓ from its grain diameter.

    Parameters
    ----------
    scene
        The `scene` section of a campaign, which gives `half_width` or the `diameter` of grains.
    value
        The variables in SI units, by name; numbers or arrays.
    """
    if scene.diameter is None:
        return float(scene.half_width)
    return 0.5 * scene.diameter * scene.particles ** (1.0 / 3.0) / value["size_ratio"]


def grain_radius(scene: Any, value: Mapping[str, float]) -> float:
    """Return the radius of a grain b⁰ = ℓ D/N^⅓ in m; ℓ is the diameter over the spacing 2D/N^⅓.

    Where the scene gives the diameter of grains it is half of that; arguments as for `half_width`.
    """
    if scene.diameter is not None:
        return 0.5 * float(scene.diameter)
    return 0.5 * value["size_ratio"] * 2.0 * scene.half_width / scene.particles ** (1.0 / 3.0)


def grain_mass(scene: Any, value: Mapping[str, float]) -> float:
    """Return the mass of a grain in kg; arguments as for `half_width`.

    Raises
    ------
    ValueError
        If it is not between `LIGHTEST` and `HEAVIEST`.
    """
    radius = grain_radius(scene, value)
    power = math.log10(value["density"]) + 3.0 * math.log10(radius) if radius > 0.0 else -math.inf
    # A power of a length is not the same in every unit, in the last digit; products are.
    cube = radius * radius * radius if abs(power) < 200.0 else math.nan
    mass = value["density"] * 4.0 / 3.0 * math.pi * cube
    if not LIGHTEST <= mass <= HEAVIEST:
        raise ValueError(
            f"a grain of radius {radius:.3g} m and density {value['density']:.3g} kg/m^3 has a "
            f"mass that is not between {LIGHTEST:g} and {HEAVIEST:g} kg"
        )
    return mass


def critical_speed(scene: Any, value: Mapping[str, float], exponent: float | None = None) -> float:
    """Return the approach speed in m/s that separates bonding from bouncing for two mean grains.

    That up to which they stick; under a law by which none stick, that from which they bond, at the
    starting temperature: the heat of an impact softens them, so that they may bond from a lower
    speed on. Arguments as for `half_width` and `Restitution.critical_speeds`; nan without one.

    Raises
    ------
    OverflowError
        If the hardness at the starting temperature is no number.
    """
    speeds = scene.restitution.critical_speeds(scene, value, exponent)
    return float(speeds.bonds_from if math.isnan(speeds.sticks_to) else speeds.sticks_to)


def mean_approach(scene: Any, value: Mapping[str, float]) -> float:
    """Return the mean approach speed of grains that collide in m/s; arguments as for `half_width`.

    √(πT/m) along the line of centres, once the starting velocities have become a Maxwellian of the
    same energy, T/m a third of `speed_variance`: w is distributed as w exp(−mw²/(4T)).
    """
    return math.sqrt(math.pi * speed_variance(scene, value) / 3.0)


def mean_pair(scene: Any, value: Mapping[str, float], speed: float) -> ContactPair:
    """Return two mean grains that meet head on with an approach speed in m/s.

    They have the starting temperature, 0 K where the scene has none; arguments as for `half_width`.
    """
    mass, radius = grain_mass(scene, value), grain_radius(scene, value)
    temperature = 0.0 if math.isnan(value["temperature"]) else value["temperature"]
    masses, radii = (mass, mass, 0.5 * mass), (radius, radius, radius)
    frame = (0.5 * speed, -0.5 * speed, 0.0, 0.0)
    return ContactPair(speed, 0.0, *masses, *radii, temperature, temperature, *frame)


def end_time(scene: Any, value: Mapping[str, float]) -> float:
    """Return the end time in s; T = (S/v_crit)·ln(0.01)/ln(0.9) if the scene says so  [A 13].

    S is the mean gap between neighbours and v_crit the `critical_speed`; arguments as for
    `half_width`.

    Raises
    ------
    ValueError
        If the critical speed is not positive and finite.
    """
    if not isinstance(scene.end_time, str):
        return float(scene.end_time)
    spacing = 2.0 * half_width(scene, value) / scene.particles ** (1.0 / 3.0)
    exponent = scene.hardness.exponent(value)
    if exponent > LARGEST_EXPONENT:
        raise ValueError(
            f"the characteristic end time vanishes where {scene.hardness.exponent_symbol} is "
            f"{exponent:.4g}; must be at most {LARGEST_EXPONENT:g}, or give a time like '10 ms'"
        )
    speed = critical_speed(scene, value)
    if not 0.0 < speed < math.inf:
        raise ValueError(
            f"the characteristic end time needs a critical speed, which is {speed:g} m/s; "
            "give a time like '10 ms'"
        )
    gap = spacing - 2.0 * grain_radius(scene, value)
    return gap / speed * math.log(0.01) / math.log(0.9)


def speed_variance(scene: Any, value: Mapping[str, float]) -> float:
    """Return ⟨|v − ⟨v⟩|²⟩ of the starting velocities in m²/s²; arguments as for `half_width`."""
    return float(scene.velocities.variance(value["relative_speed"]))


def fastest_approach(scene: Any, value: Mapping[str, float]) -> float:
    """Return the highest approach speed of two grains at the start in m/s.

    Arguments as for `half_width`.
    """
    return float(scene.velocities.fastest_approach(value["relative_speed"]))


def collision_rate(scene: Any, value: Mapping[str, float]) -> float:
    """Return the collisions per grain and s if all were elastic, by Enskog's theory.

    ω = 4nσ²χ√(πT/m) of the equal spheres at the start, with the contact value χ of Carnahan and
    Starling, once the starting velocities have become a Maxwellian of the same energy: T/m is a
    third of `speed_variance`. Losses make it smaller, bonding makes it end. Of grains of different
    sizes it is the mean over them, with the contact values of mixtures; arguments as for
    `half_width`.
    """
    diameter = 2.0 * grain_radius(scene, value)
    density, variance = value["size_ratio"] ** 3 / diameter**3, speed_variance(scene, value)
    if scene.size_law is None:
        return enskog_rate(density, diameter, variance / 3.0, 1.0)
    shares, rates = _size_rates(scene.size_law, density, diameter, variance)
    return float(shares @ rates)


def _size_rates(law: SizeLaw, density: float, diameter: float, variance: float) -> tuple[Any, Any]:
    """Return shares of the grains' size classes, and the collisions per s of a grain of each, (n,).

    `density` is of all grains in 1/m³, `diameter` their mean one in m, `variance` of all speeds.
    """
    ratios, shares = size_classes(law)
    masses = ratios**3
    temperature = float(shares @ masses) * variance / 3.0
    rates = mixture_rates(density * shares, diameter * ratios, masses, temperature)
    return shares, rates.sum(axis=1)


def number_density(scene: Any, value: Mapping[str, Any]) -> Any:
    """Return the grains per volume at the start in 1/m³; arguments as for `half_width`."""
    side = 2.0 * half_width(scene, value)
    return scene.particles / (side * side * side)


def free_path(scene: Any, value: Mapping[str, Any]) -> Any:
    """Return the mean free path of elastic grains at the start in m, as `collision_rate`.

    Of grains of different sizes it is their mean speed over their mean rate; arguments as for
    `half_width`.
    """
    diameter, density = 2.0 * grain_radius(scene, value), number_density(scene, value)
    if scene.size_law is None:
        return mean_free_path(density, diameter)
    ratios, shares = size_classes(scene.size_law)
    masses = ratios**3
    speed = float(shares @ np.sqrt(8.0 / math.pi * float(shares @ masses) / masses))
    rates = np.vectorize(lambda n, d: float(shares @ _size_rates(scene.size_law, n, d, 3.0)[1]))
    return speed / rates(density, diameter)


def expected_collisions(scene: Any, value: Mapping[str, float]) -> float:
    """Return the collisions per grain until the end time, by `collision_rate`."""
    return collision_rate(scene, value) * end_time(scene, value)
