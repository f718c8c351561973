"""Draw temperature and stress of steadily sheared grains beside theory, for `simulation/README`.

python tests/benchmarks/plot_sheared_gas.py jobs/pictures/sheared_gas.png

It prints each point with its standard error, and takes some minutes of processor time.
"""

import math
import sys
from pathlib import Path

import numpy as np

TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(TESTS / "simulation"), str(TESTS / "helpers")]

import matplotlib.pyplot as plt  # noqa: E402
from sheared_gas import enskog, navier_stokes, steady_state  # noqa: E402

FRACTIONS = (0.1, 0.3)
RESTITUTIONS = np.array([0.8, 0.85, 0.9, 0.95])
SAMPLES, SEEDS = 8, 4
"""Samples of each box, and Monte Carlo runs of the Enskog equation."""

BOXES = ((100, (15.0, 215.0), "o"), (1000, (15.0, 75.0), "s"))
"""Grains, strains from and to which they are measured, marker."""

TITLES = ("(1 − e²) T / (m a² σ²)", "√(1 − e²) stress / (m a² / σ)")


def scaled(e, values):
    """Return temperature and stress without what they diverge by where nothing dissipates."""
    loss = 1.0 - e * e
    return np.asarray(values) * (loss, math.sqrt(loss))


def mean_and_error(name, e, fraction, values):
    found = np.array([scaled(e, each) for each in values])
    mean, error = found.mean(axis=0), found.std(axis=0, ddof=1) / math.sqrt(len(found))
    ratio = mean / scaled(e, navier_stokes(e, fraction))
    print(name, e, fraction, mean.round(4), "±", error.round(4), ratio.round(3), flush=True)
    return mean, error


def draw_points(panels, name, fraction, style, sampled):
    """Draw what `sampled` returns for each restitution, with error bars."""
    found = [mean_and_error(name, e, fraction, sampled(e)) for e in RESTITUTIONS]
    for panel, (mean, error) in zip(panels, np.transpose(found, (2, 1, 0)), strict=True):
        panel.errorbar(RESTITUTIONS, mean, error, ls="none", label=name, **style)


def draw(path):
    figure, panels = plt.subplots(1, 2, figsize=(8.6, 3.6))
    fine = np.linspace(0.79, 0.96, 60)
    for k, fraction in enumerate(FRACTIONS):
        theory = np.array([scaled(e, navier_stokes(e, fraction)) for e in fine])
        for panel, curve in zip(panels, theory.T, strict=True):
            panel.plot(fine, curve, f"C{k}-", lw=1, label="Garzó and Dufty")
        cross = {"color": f"C{k}", "marker": "x", "ms": 7}
        runs = lambda e, phi=fraction: [enskog(e, phi, seed) for seed in range(SEEDS)]  # noqa: E731
        draw_points(panels, "Enskog, Monte Carlo", fraction, cross, runs)
        for grains, strains, marker in BOXES:
            style = {"color": f"C{k}", "marker": marker, "ms": 5, "mfc": "none"}
            box = lambda e, phi=fraction, n=grains, to=strains: [  # noqa: E731
                steady_state(e, phi, n, seed, to) for seed in range(SAMPLES)
            ]
            draw_points(panels, f"{grains} grains", fraction, style, box)
    for panel, title in zip(panels, TITLES, strict=True):
        panel.set(xlabel="restitution e", ylabel=title, ylim=(0.0, None))
    figure.tight_layout()
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    draw(sys.argv[1])
