"""Draw temperature and stress of steadily sheared grains beside theory, for `simulation/README`.

cd jobs/pictures; python ../../tests/benchmarks/plot_sheared_gas.py sheared_gas.csv sheared_gas.png

Points that the first file does not have are measured and added to it: some minutes of processor
time if there are none.
"""

import csv
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

KINDS = {"Enskog, Monte Carlo": "x", "100 grains": "o", "1000 grains": "s"}
STRAINS = {100: (15.0, 215.0), 1000: (15.0, 75.0)}
"""Strains from and to which boxes are measured, by their grains."""

TITLES = ("(1 − e²) T / (m a² σ²)", "√(1 − e²) stress / (m a² / σ)")


def scaled(e, values):
    """Return temperature and stress without what they diverge by where nothing dissipates."""
    loss = 1.0 - e * e
    return np.asarray(values) * (loss, math.sqrt(loss))


def measured(kind, fraction, e):
    """Return scaled temperature, its standard error, scaled stress and its standard error."""
    if kind in ("100 grains", "1000 grains"):
        count = int(kind.split()[0])
        values = [steady_state(e, fraction, count, k, STRAINS[count]) for k in range(SAMPLES)]
    else:
        values = [enskog(e, fraction, seed) for seed in range(SEEDS)]
    found = np.array([scaled(e, each) for each in values])
    mean, error = found.mean(axis=0), found.std(axis=0, ddof=1) / math.sqrt(len(found))
    return np.stack([mean, error], axis=1).ravel().round(4)


def points_of(path):
    """Return all points by kind, volume fraction and restitution; missing ones are added."""
    path.touch()
    with path.open(newline="") as file:
        known = {
            (row[0], float(row[1]), float(row[2])): np.array(row[3:], float)
            for row in csv.reader(file)
        }
    with path.open("a", newline="") as file:
        for case in ((k, f, e) for f in FRACTIONS for k in KINDS for e in RESTITUTIONS):
            if case not in known:
                known[case] = measured(*case)
                csv.writer(file).writerow([*case, *known[case]])
                file.flush()
    return known


def draw(points, path):
    figure, panels = plt.subplots(1, 2, figsize=(8.6, 3.6))
    fine = np.linspace(0.79, 0.96, 60)
    for k, fraction in enumerate(FRACTIONS):
        theory = np.array([scaled(e, navier_stokes(e, fraction)) for e in fine])
        for p, panel in enumerate(panels):
            label = f"Garzó and Dufty, φ = {fraction}"
            panel.plot(fine, theory[:, p], f"C{k}-", lw=1, label=label)
            for kind, marker in KINDS.items():
                found = np.array([points[kind, fraction, e][2 * p :][:2] for e in RESTITUTIONS])
                style = {"color": f"C{k}", "marker": marker, "ms": 6, "mfc": "none"}
                name = None if k else kind
                panel.errorbar(RESTITUTIONS, *found.T, ls="none", label=name, **style)
    for panel, title in zip(panels, TITLES, strict=True):
        panel.set(xlabel="restitution e", ylabel=title, ylim=(0.0, None), xticks=RESTITUTIONS)
    panels[1].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    draw(points_of(Path(sys.argv[1])), sys.argv[2])
