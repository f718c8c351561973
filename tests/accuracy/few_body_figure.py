"""The figure of the README of `accuracy`: `python tests/accuracy/few_body_figure.py OUT`.

Position error of the steppers after a few impacts, against their step; that of the event engine is
rounding.
"""

import sys
from pathlib import Path

import numpy as np
from few_body_reference import bouncing
from few_body_study import FULL, study

from agglom_mpi.accuracy.report import Curve, draw_curves
from agglom_mpi.report.style import Drawing, write_drawing

SHOWN = ("head-on", "three in sequence", "two pairs")
"""Scenes in the figure; the adaptive engine does not see the last one coming."""


def write_figure(directory):
    """Measure, and write `few_spheres.png` and `few_spheres.svg`."""
    frame = study(bouncing(), FULL, np.random.default_rng(2004))
    frame = frame[(frame["engine"] != "event") & frame["scene"].isin(SHOWN)]
    curves = []
    for (scene, engine), rows in frame.groupby(["scene", "engine"], sort=False):
        half = 1.96 * rows["position error, standard error"]
        error = rows["position error"]
        low = np.maximum(error - half, 1e-3 * error)
        curves.append(Curve(f"{engine}: {scene}", rows["step (s)"], error, low, error + half))

    def draw(figure):
        draw_curves(figure, curves, "(shortest) step (s)", "position error (box edges)")

    write_drawing(directory, Drawing("few_spheres", "", draw))


if __name__ == "__main__":
    write_figure(Path(sys.argv[1]))
