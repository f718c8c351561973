"""Kinetic theory of smooth elastic spheres in equilibrium: collision rates and free paths.

Rates count collisions per sphere and time, so N spheres have N/2 times as many.

[CC]  S. Chapman, T. G. Cowling, The Mathematical Theory of Non-uniform Gases, 3rd ed.,
      Cambridge University Press, 1970: rates and free path 5.2, Enskog's dense gas 16.
[CS]  N. F. Carnahan, K. E. Starling, J. Chem. Phys. 51, 635 (1969): equal spheres.
[BMCSL] T. Boublik, J. Chem. Phys. 53, 471 (1970); G. A. Mansoori, N. F. Carnahan, K. E. Starling,
      T. W. Leland, J. Chem. Phys. 54, 1523 (1971): mixtures.
"""

import math

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


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


def mixture_contact_values(densities: Floats, diameters: Floats) -> Floats:
    """Return the pair correlations at contact χ_ij of a mixture, shape (n, n)  [BMCSL].

    χ_ij = 1/(1 − ξ₃) + 3 ξ₂ s/(1 − ξ₃)² + 2 ξ₂² s²/(1 − ξ₃)³ with s = σ_i σ_j/(σ_i + σ_j) and
    ξ_k = (π/6) Σ n_i σ_i^k; of equal spheres that of `contact_value`.

    Parameters
    ----------
    densities
        Spheres per m³ of each species n_i, shape (n,).
    diameters
        Their diameters σ_i in m, shape (n,).
    """
    second, third = (math.pi / 6.0 * float(np.sum(densities * diameters**k)) for k in (2, 3))
    free = 1.0 - third
    reduced = second * np.multiply.outer(diameters, diameters) / np.add.outer(diameters, diameters)
    return np.asarray(1.0 / free + 3.0 * reduced / free**2 + 2.0 * reduced**2 / free**3)


def mixture_rates(
    densities: Floats, diameters: Floats, masses: Floats, temperature: float
) -> Floats:
    """Return the collisions per s of a sphere of species i with those of j, shape (n, n).

    ω_ij = n_j σ_ij² χ_ij √(8πT/μ_ij) with σ_ij = (σ_i + σ_j)/2 and the reduced mass μ_ij: all
    species have the same granular temperature in equilibrium  [CC 5.2, 16].

    Parameters
    ----------
    densities, diameters, masses
        Spheres per m³, diameters in m and masses in kg of each species, shape (n,).
    temperature
        Granular temperature T = m⟨v²⟩/3 in J, about the mean velocity.
    """
    distance = 0.5 * np.add.outer(diameters, diameters)
    reduced_mass = np.multiply.outer(masses, masses) / np.add.outer(masses, masses)
    speed = np.sqrt(8.0 * math.pi * temperature / reduced_mass)
    chi = mixture_contact_values(densities, diameters)
    return np.asarray(densities[None, :] * distance**2 * chi * speed)
