"""Make up measurements of grains whose flow and material are known, for measured.yaml.

python jobs/measured/measure.py writes the files of counts beside it and prints the temperature.
"""

from pathlib import Path

import numpy as np

import agglom_mpi

TRUTH = {"relative_speed": 50.0, "hardness": 60e6, "heat_capacity": 400.0}
TIMES = {"after_2_ms.csv": 2e-3, "after_10_ms.csv": 10e-3}  # s
SAMPLES, COUNTED, TEMPERATURE_ERROR = 200, 500, 0.01  # grains counted at each time; K
CLASSES = [2.6, 3.1, 3.5, 3.8, 4.3, 5.0]  # mm, between the classes of diameter

folder = Path(__file__).parent


def measure(random: np.random.Generator) -> float:
    """Write the counts at each time, and return the temperature in K."""
    campaign = agglom_mpi.load_campaign(folder / "measured.yaml")
    times = list(TIMES.values())
    frames = [campaign.simulate(TRUTH, k, frames=times).frames for k in range(SAMPLES)]
    for place, name in enumerate(TIMES):
        radii = np.concatenate([f.radii[place, : f.particles[place]] for f in frames])
        seen = 2e3 * random.choice(radii, COUNTED)  # mm
        counts, _ = np.histogram(seen, [0.0, *CLASSES, np.inf])
        rows = [f"<{CLASSES[0]:g}", *map("{:g}-{:g}".format, CLASSES, CLASSES[1:])]
        rows.append(f">{CLASSES[-1]:g}")
        lines = [f"{row};{count}" for row, count in zip(rows, counts, strict=True)]
        (folder / name).write_text("\n".join(["diameter (mm);count", *lines]) + "\n")
    ends = [(frame.temperatures[-1], frame.masses[-1], frame.particles[-1]) for frame in frames]
    heats = [np.average(kelvin[:n], weights=masses[:n]) for kelvin, masses, n in ends]
    return float(np.mean(heats) + TEMPERATURE_ERROR * random.standard_normal())


if __name__ == "__main__":
    print(f"temperature {measure(np.random.default_rng(7)):.2f} K, known to {TEMPERATURE_ERROR} K")
