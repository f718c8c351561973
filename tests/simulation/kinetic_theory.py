"""What kinetic theory says of equal smooth hard spheres beyond `physics.kinetic_theory`.

Collision rates of few spheres, and cooling. Temperature is m⟨v²⟩/3 in J, about the mean
velocity; rates count collisions per sphere and time, so N spheres have N/2 times as many. Of N
spheres whose total momentum is zero, 3N − 3 velocity components are free: a gas at temperature Θ,
in the sense of Θ/2 per free component, has ⟨v²⟩ = 3(1 − 1/N)Θ/m, and a pair's relative velocity
has the variance 2Θ/m of each component that the theory expects. In small systems, use Θ for T
(`free_temperature`); `finite_rate` adds that a sphere has N − 1 partners, and that energy is
shared out exactly.

[H]    P. K. Haff, J. Fluid Mech. 134, 401 (1983).
[NE]   T. P. C. van Noije, M. H. Ernst, Granular Matter 1, 57 (1998).
[BP]   N. V. Brilliantov, T. Pöschel, Kinetic Theory of Granular Gases, Oxford, 2004.
"""

import math

import numpy as np

from agglom_mpi.physics.kinetic_theory import contact_value, volume_fraction


def temperature(velocities, mass):
    """m⟨v²⟩/3 about the mean velocity."""
    return mass * np.mean(np.sum((velocities - velocities.mean(axis=0)) ** 2, axis=1)) / 3.0


def free_temperature(velocities, mass):
    """Θ: twice the energy per free velocity component, of which there are 3N − 3."""
    number = len(velocities)
    return temperature(velocities, mass) * number / (number - 1)


def finite_rate(number, volume, diameter, free, mass):
    """ω of N spheres with zero total momentum and the energy (3N − 3)Θ/2, at Θ = `free`.

    With f = 3N − 3 free components, uniform on the sphere of fixed energy, three components make
    a relative velocity of mean magnitude √(2fΘ/m)·Γ(2)Γ(f/2)/(Γ(3/2)Γ((f + 1)/2)), instead of
    4√(Θ/(πm)). χ stays as in an infinite system; by the cluster expansion it is 3φ/N more.
    """
    components = 3 * (number - 1)
    ratio = math.exp(math.lgamma(0.5 * components) - math.lgamma(0.5 * (components + 1)))
    relative = math.sqrt(2.0 * components * free / mass) * ratio / math.gamma(1.5)
    chi = contact_value(volume_fraction(number / volume, diameter))
    return (number - 1) / volume * chi * math.pi * diameter**2 * relative


def energy_loss(restitution, temperature):
    """Mean energy that a collision dissipates, (1 − e²)T  [BP].

    ½m*w²(1 − e²) with m* = m/2 and ⟨w²⟩ = 4T/m: a component of relative velocity has the
    variance 2T/m, and collisions meet it in proportion to w·exp(−mw²/(4T)).
    """
    return (1.0 - restitution**2) * temperature


def haff_temperature(time, initial, restitution, rate):
    """T = T₀/(1 + (1 − e²)ω₀t/6)², with ω₀ = `rate` at T₀, for constant e  [H].

    Nω/2 collisions per time take (1 − e²)T each from 3NT/2: dT/dt = −(1 − e²)ωT/3, and ω ~ √T.
    Gaussian velocities; `haff_correction` multiplies ω₀ for the first correction to these. In
    small systems with T = Θ and `finite_rate` the energy is (3N − 3)Θ/2: multiply by N/(N − 1).
    """
    return initial / (1.0 + (1.0 - restitution**2) * rate * time / 6.0) ** 2


def haff_collisions(time, restitution, rate):
    """Collisions per sphere up to a time in Haff's state, 6/(1 − e²)·ln(1 + (1 − e²)ω₀t/6)."""
    loss = 1.0 - restitution**2
    return 6.0 / loss * math.log1p(loss * rate * time / 6.0) if loss > 0.0 else rate * time


def sonine_coefficient(restitution):
    """a₂ = 16(1 − e)(1 − 2e²)/(81 − 17e + 30e²(1 − e)) of the homogeneous cooling state  [NE].

    The velocity distribution is a Gaussian times 1 + a₂S₂(c²), c² = mv²/(2T), with
    S₂(x) = x²/2 − 5x/2 + 15/8; terms of order a₂² are left out.
    """
    e = restitution
    return 16.0 * (1.0 - e) * (1.0 - 2.0 * e**2) / (81.0 - 17.0 * e + 30.0 * e**2 * (1.0 - e))


def rate_correction(restitution):
    """Factor 1 − a₂/16 on the collision rate at a given T, to first order in a₂  [NE, BP]."""
    return 1.0 - sonine_coefficient(restitution) / 16.0


def haff_correction(restitution):
    """Factor 1 + 3a₂/16 on the cooling rate at a given T, to first order in a₂  [NE, BP]."""
    return 1.0 + 3.0 * sonine_coefficient(restitution) / 16.0


def maxwellian(masses, free, generator, exact=True):
    """Velocities at zero total momentum and Θ = `free`, shape (N, 3).

    Gaussians less the velocity of their centre of mass are Gaussians given that the total
    momentum is zero. If `exact`, they are scaled to the energy (3N − 3)Θ/2.
    """
    masses = np.asarray(masses, dtype=float)
    v = generator.normal(size=(len(masses), 3)) * np.sqrt(free / masses)[:, None]
    v -= masses @ v / masses.sum()
    if exact:
        v *= math.sqrt(3.0 * (len(masses) - 1) * free / float(masses @ np.sum(v**2, axis=1)))
    return v
