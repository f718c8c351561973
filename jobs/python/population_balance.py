r"""Growth of sticking grains by measured kernels in another code: particula, a model of aerosols.

    agglom kernels jobs/polymer_dust.yaml --set relative_speed=1 --time 2e-4 --time 4e-4 \
        --time 7e-4 --time 1e-3 --time 1.5e-3 --time 2e-3 --time 3e-3 --netcdf kernels.nc
    python jobs/python/population_balance.py kernels.nc

particula (https://pypi.org/project/particula) follows 20 000 particles, a pair of which sticks at
the rate of collisions times the sticking probability. A pair of masses without coefficients takes
those of the nearest pair that has them. The table has the mean number of particles of the direct
samples in each window of time; the mean mass is the total mass over it.
"""

import sys

import numpy as np
import particula
from particula.dynamics.coagulation.coagulation_strategy.coagulation_strategy_abc import (
    CoagulationStrategyABC,
)
from scipy.interpolate import NearestNDInterpolator, RegularGridInterpolator
from scipy.io import netcdf_file

PARTICLES = 20_000
STEPS = 40  # per window; few particles may stick in a step


class MeasuredKernel(CoagulationStrategyABC):
    """Rates at which pairs of radii stick, shape (bins, bins), m³/s."""

    def __init__(self, radii, rates, seed):
        super().__init__("particle_resolved")
        known = np.isfinite(rates)
        nearest = NearestNDInterpolator(np.argwhere(known), rates[known])
        filled = nearest(*np.indices(rates.shape))
        axes = (np.log(radii), np.log(radii))
        self.rate = RegularGridInterpolator(axes, filled, bounds_error=False, fill_value=None)
        self.random_generator = np.random.default_rng(seed)

    def kernel(self, particle, temperature, pressure):
        """Return the rates of all pairs of the radii of binned particles, m³/s."""
        radii = np.log(particle.get_radius())
        return self.rate(tuple(np.meshgrid(radii, radii)))

    def dimensionless_kernel(self, diffusive_knudsen, coulomb_potential_ratio):
        """Rates in a fluid, which there is none of."""
        raise NotImplementedError


def read(path):
    """Return the arrays of a file of `agglom kernels --netcdf`."""
    with netcdf_file(path, mmap=False) as file:
        return {name: np.array(each[...]) for name, each in file.variables.items()}


def population(table, particles):
    """Return particles of particula with the masses and the density of the samples at the start."""
    start = table["start_particles"]
    masses = np.repeat(table["mass"], np.rint(start / start.sum() * particles).astype(int))
    volume = table["volume"] * len(masses) / start.sum()
    return (
        particula.particles.ResolvedParticleMassRepresentationBuilder()
        .set_distribution_strategy(particula.particles.ParticleResolvedSpeciatedMass())
        .set_activity_strategy(particula.particles.ActivityIdealMass())
        .set_surface_strategy(particula.particles.SurfaceStrategyVolume())
        .set_mass(masses, "kg")
        .set_density(np.array([table["density"]]), "kg/m^3")
        .set_charge(np.zeros(len(masses)))
        .set_volume(float(volume), "m^3")
        .build()
    )


def grow(table, particles=PARTICLES, seed=1):
    """Return the mean number of particles in each window, for the box of a sample."""
    radii = np.cbrt(3.0 * table["mass"] / (4.0 * np.pi * table["density"]))
    grown, means = population(table, particles), []
    scale = table["volume"] / grown.get_volume()
    for w, duration in enumerate(np.diff(table["time"])):
        sticking = MeasuredKernel(radii, table["rate"][w] * table["sticking"][w], [seed, w])
        numbers = [np.count_nonzero(grown.get_radius())]
        for _ in range(STEPS):  # air has no part in these rates
            sticking.step(grown, temperature=300.0, pressure=1e5, time_step=duration / STEPS)
            numbers.append(np.count_nonzero(grown.get_radius()))
        means.append(np.trapezoid(numbers) / STEPS * scale)
    return np.array(means)


if __name__ == "__main__":
    table = read(sys.argv[1])
    direct = table["start_particles"].sum() / table["mean_particles"]
    there = table["start_particles"].sum() / grow(table)
    errors = direct * table["mean_particles_error"] / table["mean_particles"]
    for end, mean, error, other in zip(table["time"][1:], direct, errors, there, strict=True):
        print(f"up to {end:.3g} s: mean mass (grains) {mean:.3f} ± {error:.3f}", end=", ")
        print(f"by particula {other:.3f}")
    # up to 0.0002 s: mean mass (grains) 1.067 ± 0.001, by particula 1.071
    # up to 0.0004 s: mean mass (grains) 1.242 ± 0.003, by particula 1.242
    # up to 0.0007 s: mean mass (grains) 1.530 ± 0.005, by particula 1.531
    # up to 0.001 s: mean mass (grains) 1.992 ± 0.009, by particula 1.984
    # up to 0.0015 s: mean mass (grains) 2.827 ± 0.015, by particula 2.819
    # up to 0.002 s: mean mass (grains) 4.253 ± 0.018, by particula 4.242
    # up to 0.003 s: mean mass (grains) 7.066 ± 0.038, by particula 7.133
    # up to 0.005 s: mean mass (grains) 15.446 ± 0.195, by particula 16.062
    # At the end a sample has 13 particles, which is no gas any more.
