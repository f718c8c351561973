"""Draw numbers and energies of sticking grains, simulated and by equations, for `analysis/README`.

python tests/benchmarks/plot_population_balance.py jobs/pictures/population_balance.png
"""

import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from agglom_mpi import load_campaign

SCENE = """\
scene:
  {{particles: 2000, heating: none, {scene}, end_time: {end},
   velocities: {{law: spread, mean: [0, 0, 0], transverse: 1}},
   restitution: {{{law}, dry: {{law: constant, value: 0.9}}}}}}
variables: {{relative_speed: 1, volume_fraction: 0.01, density: 2500, {value}}}
"""
DUST = {
    "scene": "grain_radius: 1 um",
    "law": "law: adhesive, youngs_modulus: 70 GPa",
    "value": "surface_energy: 0.2",
}
WET = {
    "scene": "grain_radius: 1 mm",
    "law": "law: wet, film_thickness: 20 um, roughness: 1 um",
    "value": "restitution.viscosity: 100 mPa*s",
}
CASES = {"dust (adhesive)": (DUST, 4e-3), "wet grains": (WET, 4.0)}
WINDOWS = 13
SAMPLES = 60


def found_of(case, end):
    """Kernels of a case; windows grow geometrically."""
    times = np.geomspace(end / 200.0, end, WINDOWS)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(SCENE.format(end=end, **case))
        campaign = load_campaign(path)
        return campaign.collision_kernels(campaign.parameters(), SAMPLES, times=times[:-1])


def draw(path):
    figure, panels = plt.subplots(1, 2, figsize=(8, 3.4))
    for k, (name, (case, end)) in enumerate(CASES.items()):
        found = found_of(case, end)
        (value, error), solved = found.means, found.balance()
        times = 0.5 * (found.times[1:] + found.times[:-1]) / end
        grown, energies = 2000.0 / value[:, 0], value[:, 1] / value[0, 1]
        curves = 2000.0 / solved[:, 0], solved[:, 1] / value[0, 1]
        errors = grown * error[:, 0] / value[:, 0], energies * error[:, 1] / value[:, 1]
        for panel, mean, spread, curve in zip(
            panels, (grown, energies), errors, curves, strict=True
        ):
            panel.errorbar(times, mean, 2.0 * spread, fmt=f"C{k}o", ms=4, label=f"{name}, samples")
            panel.plot(times, curve, f"C{k}-", lw=1, label="equations")
        print(name)
        ratios = np.column_stack((grown, solved / value, error / value))
        print(np.array2string(ratios, precision=4, suppress_small=True))
    for panel, label in zip(panels, ("mean mass (grains)", "kinetic energy / first"), strict=True):
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_xlabel("time / end time")
        panel.set_ylabel(label)
    panels[0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    draw(sys.argv[1])
