"""Kinetic theory of equal smooth elastic spheres in equilibrium: collision rate and free path.

Rates count collisions per sphere and time, so N spheres have N/2 times as many.

[CC]  S. Chapman, T. G. Cowling, The Mathematical Theory of Non-uniform Gases, 3rd ed.,
      Cambridge University Press, 1970: rates and free path 5.2, Enskog's dense gas 16.
[CS]  N. F. Carnahan, K. E. Starling, J. Chem. Phys. 51, 635 (1969).
"""

import math


def contact_value(fraction: float) -> float:
    """Return the pair correlation at contact χ = (1 − φ/2)/(1 − φ)³ at a volume fraction φ [CS]."""
    return (1.0 - 0.5 * fraction) / (1.0 - fraction) ** 3


def volume_fraction(density: float, diameter: float) -> float:
    """Return φ = πnσ³/6 of n spheres per m³ of diameter σ in m."""
    return math.pi / 6.0 * density * diameter**3


def enskog_rate(density: float, diameter: float, temperature: float, mass: float) -> float:
    """Return the collisions per sphere and s, ω = 4nσ²χ√(πT/m)  [CC 5.2, 16].

    Twice the rate of pairs per sphere: ω = nχπσ²⟨g⟩ with the mean relative speed
    ⟨g⟩ = √2⟨v⟩ = 4√(T/(πm)).

    Parameters
    ----------
    density
        Spheres per m³, n.
    diameter
        Diameter σ in m.
    temperature
        Granular temperature T = m⟨v²⟩/3 in J, about the mean velocity.
    mass
        Mass of a sphere m in kg.
    """
    chi = contact_value(volume_fraction(density, diameter))
    return 4.0 * density * diameter**2 * chi * math.sqrt(math.pi * temperature / mass)


def mean_free_path(density: float, diameter: float) -> float:
    """Return ⟨v⟩/ω = 1/(√2 π n σ² χ) in m, with ⟨v⟩ = √(8T/(πm))  [CC 5.2, 16]."""
    chi = contact_value(volume_fraction(density, diameter))
    return 1.0 / (math.sqrt(2.0) * math.pi * density * diameter**2 * chi)
