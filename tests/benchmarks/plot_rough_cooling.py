"""Draw both temperatures of cooling rough grains beside kinetic theory, for `simulation/README`.

python tests/benchmarks/plot_rough_cooling.py jobs/pictures/rough_cooling.png
"""

import sys
from pathlib import Path

import numpy as np

TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(TESTS / "simulation"), str(TESTS / "helpers")]

import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.ticker import NullLocator  # noqa: E402
from rough_cooling import collision_rate, cooled, gas, temperatures  # noqa: E402

from agglom_mpi.report.style import (  # noqa: E402
    COLOURS,
    DOTS_PER_INCH,
    PAGE,
    finish,
    styled,
)

CASES = ((0.95, 0.9, 0.0), (0.95, -0.5, 1.0), (0.9, 0.0, 0.0))
"""Restitution, tangential restitution and starting ratio of the temperatures."""

SAMPLES = 20
COLLISIONS = np.array([5.0, 8.0, 13.0, 20.0, 32.0, 50.0, 80.0])


@styled()
def draw(path):
    figure, panels = plt.subplots(
        1, len(CASES), figsize=(PAGE, 2.7), sharey=True, layout="constrained"
    )
    for panel, (e, beta, ratio) in zip(panels, CASES, strict=True):
        scene = gas(e, 1e6, beta, ratio, 2000, 0.05)
        start = scene.mass * scene.velocities.relative_speed**2 / 3.0
        rate = collision_rate(scene, start)
        mean = temperatures(scene, COLLISIONS / rate, range(SAMPLES)).mean(axis=0)
        theory = cooled(scene, e, beta, mean[:, 0], COLLISIONS / rate)
        fine = np.geomspace(COLLISIONS[0], COLLISIONS[-1], 100)
        curves = cooled(scene, e, beta, mean[:, 0], fine / rate)
        for k, name in enumerate(("translational", "rotational")):
            panel.loglog(fine, curves[k] / start, "-", c=COLOURS[k], lw=1)
            panel.loglog(COLLISIONS, mean[k] / start, "o", c=COLOURS[k], label=name)
        panel.set_title(f"e = {e:g}, β₀ = {beta:g}")
        panel.xaxis.set_minor_locator(NullLocator())
        panel.set_xticks([5, 10, 20, 40, 80], ["5", "10", "20", "40", "80"])
        panel.set_xlabel("time × starting collision rate")
        print(e, beta, np.round(100.0 * (mean / theory - 1.0), 1).tolist())
    panels[0].set_ylabel("temperature / starting temperature")
    panels[0].legend()
    figure.draw_without_rendering()
    finish(panels)
    figure.savefig(path, dpi=DOTS_PER_INCH)


if __name__ == "__main__":
    draw(sys.argv[1])
