"""Draw the growth of barrier.yaml at imposed speeds, and the size from which most impacts bounce.

Run it as `python barrier.py`; it prints both, and writes barrier.png.
"""

from pathlib import Path

import matplotlib
import numpy as np

from agglom_mpi import load_campaign
from agglom_mpi.analysis.imposed_speeds import imposed_growth, power_law

matplotlib.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
SPEED = 0.02
"""Root mean square relative speed of two grains, m/s."""
ENERGIES = (0.02, 0.04, 0.08, 0.16, 0.3)
"""Surface energies in J/m²; growth is drawn of every other one."""
UNTIL = 1.0
"""Time of growth in s."""
SAMPLES = 20
WINDOWS = (1e-4, 2e-4, 4e-4, 8e-4, 1.6e-3)
"""Ends of the windows of the samples in s: in each of them sizes grow by half."""
EXPONENTS = {0.0: "same speed", 0.5: "∝ r^½ (turbulence)", 1.0: "∝ r (shear)"}
"""Exponents of the imposed speed in the radius."""


def main():
    """Draw both panels."""
    campaign = load_campaign(HERE / "barrier.yaml")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    barriers = {exponent: [] for exponent in EXPONENTS}
    for k, energy in enumerate(ENERGIES):
        kernels = campaign.collision_kernels({"surface_energy": energy}, SAMPLES, times=WINDOWS)
        for exponent, sizes in barriers.items():
            speed = power_law(kernels.grain_mass, SPEED, exponent)
            until = UNTIL if exponent == 0.5 else 1e-6 * UNTIL
            growth = imposed_growth(kernels, speed, until)
            sizes.append(np.cbrt(growth.barrier / kernels.grain_mass))
            if exponent == 0.5 and k % 2 == 0:
                draw_growth(left, growth, kernels.grain_mass, k // 2, energy)
    left.set(xscale="log", yscale="log", xlabel="time (s)", ylabel="radius of the mean mass / b₀")
    left.set_title("relative speeds of 2 cm/s (r/b₀)^½", fontsize="medium")
    left.legend(fontsize="small")
    draw_barriers(right, barriers)
    figure.savefig(HERE / "barrier.png", dpi=120)


def draw_growth(axes, growth, grain, k, energy):
    """Draw the size over time with its band: dashed where most mass is extrapolated."""
    sizes = np.cbrt(growth.mean_mass / grain)
    known = growth.extrapolated < 0.5
    last = np.count_nonzero(known)
    axes.fill_between(growth.times, sizes[0], sizes[2], color=f"C{k}", alpha=0.3, lw=0)
    axes.plot(growth.times[:last], sizes[1, :last], f"C{k}-", label=f"{energy:g} J/m²")
    axes.plot(growth.times[last - 1 :], sizes[1, last - 1 :], f"C{k}--")
    barrier = np.cbrt(growth.barrier / grain)
    axes.plot(np.interp(barrier, sizes[1], growth.times), barrier, f"C{k}o")
    slope = np.polyfit(np.log(growth.times[-3:]), np.log(sizes[1, -3:]), 1)[0]
    print(
        f"{energy:g} J/m²: efficiency {growth.efficiency[0]:.3f} ± {growth.efficiency[1]:.3f}, "
        f"barrier {barrier:.1f}, mean mass there x{growth.mean_mass[1, -1] / growth.barrier:.0f}, "
        f"band {sizes[0, -1]:.1f} {sizes[1, -1]:.1f} {sizes[2, -1]:.1f}, late exponent {slope:.3f}"
    )


def draw_barriers(axes, barriers):
    """Draw the sizes of the barriers beside the power that theory expects."""
    energies = np.array(ENERGIES)
    for k, (exponent, sizes) in enumerate(barriers.items()):
        expected = 5.0 / 6.0 / (5.0 / 6.0 + exponent)
        axes.plot(energies, sizes, f"C{k}o", label=f"{EXPONENTS[exponent]}: γ^{expected:.2f}")
        axes.plot(energies, sizes[-1] * (energies / energies[-1]) ** expected, f"C{k}-")
        found = np.diff(np.log(sizes)) / np.diff(np.log(energies))
        print(f"exponent {exponent:g}: sizes {np.round(sizes, 2)}, powers {np.round(found, 3)}")
    axes.set(xscale="log", yscale="log", xlabel="surface energy (J/m²)", ylabel="barrier, r/b₀")
    axes.set_xticks(energies, [f"{energy:g}" for energy in ENERGIES])
    axes.minorticks_off()
    axes.legend(fontsize="small", title="relative speed")


if __name__ == "__main__":
    main()
