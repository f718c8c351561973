"""Draw the regimes of dust.yaml: sticking, bouncing and breaking in the plane of size and speed.

Lines are the laws' own closed forms, points are pairs of equal aggregates that the kernels' laws
let collide. Run it as `python regimes.py`; it writes regimes.png.
"""

from pathlib import Path

import matplotlib
import numpy as np

from agglom_mpi import load_campaign
from agglom_mpi.physics.dry_contact import sticking_speed
from agglom_mpi.physics.elastic_contact import separation_work
from agglom_mpi.physics.fragmentation import breakage
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.report.style import COLOURS, DOTS_PER_INCH, PAGE, finish, styled
from agglom_mpi.simulation.impact import solve_impact

matplotlib.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
SURFACE_ENERGY = 0.1
GRAINS = 2 ** np.arange(0, 21)
"""Numbers of grains in an aggregate."""
SPEEDS = np.geomspace(1e-3, 1e2, 31)
"""Approach speeds in m/s."""
STICKS, BOUNCES, BREAKS = range(3)
KIND_COLOURS = (COLOURS[0], "#999999", COLOURS[1])
NAMES = ("sticks", "bounces", "breaks")


def pair_of(radius, density, speed):
    """Return two equal spheres that meet head on."""
    mass = 4.0 / 3.0 * np.pi * density * radius**3
    sizes = (mass, mass, 0.5 * mass, radius, radius, radius)
    return ContactPair(speed, 0.0, *sizes, 0.0, 0.0, 0.5 * speed, -0.5 * speed, 0.0, 0.0)


def fate(laws, pair, grains):
    """Return what becomes of two equal aggregates that meet."""
    impact = solve_impact(laws, pair)
    if impact.bonds:
        return STICKS
    broken = breakage(laws.fragmentation, impact.loss, 0.0, pair.radius, int(grains))
    return BREAKS if broken.pieces > 1 else BOUNCES


def lines(section, values, laws, grains):
    """Return closed forms: sticking speed after elastic impacts, onset and end of breaking, m/s.

    Two aggregates that hardly rebound lose m*w²/2, half of which each absorbs: w = 2√(E/m*) for
    the energy E of the contacts that break, one at the onset and all at the end.
    """
    grain = 0.5 * section.grain_diameter
    radii = grain * np.cbrt(grains)
    law = section.fragmentation
    work = separation_work(law.work_constant, values["surface_energy"], 0.5 * grain, law.modulus)
    work *= law.energy_per_contact
    pairs = [pair_of(each, values["density"], 1.0) for each in radii]
    mass = np.array([pair.reduced_mass for pair in pairs])
    stick = np.array([sticking_speed(laws.restitution, pair) for pair in pairs])
    return stick, 2.0 * np.sqrt(work / mass), 2.0 * np.sqrt((grains - 1.0) * work / mass)


@styled()
def main():
    """Draw the map."""
    campaign = load_campaign(HERE / "dust.yaml")
    section, values = campaign.at(campaign.parameters({"surface_energy": SURFACE_ENERGY}))
    laws, grain = section.impact_laws(values), 0.5 * section.grain_diameter
    radii = grain * np.cbrt(GRAINS)
    figure, axes = plt.subplots(figsize=(PAGE, 3.6), layout="constrained")
    found = [
        (2e6 * radius, speed, fate(laws, pair_of(radius, values["density"], speed), grains))
        for radius, grains in zip(radii, GRAINS, strict=True)
        for speed in SPEEDS
    ]
    for kind in (STICKS, BOUNCES, BREAKS):
        points = np.array([each[:2] for each in found if each[2] == kind])
        axes.plot(*points.T, "o", ms=2.5, color=KIND_COLOURS[kind], label=NAMES[kind])
    fine = np.geomspace(1.0, GRAINS[-1], 200)
    stick, onset, end = lines(section, values, laws, fine)
    across = 2e6 * grain * np.cbrt(fine)
    axes.plot(across, stick, "-", color="black", label="sticking speed after an elastic impact")
    many = fine >= 2.0
    axes.plot(across[many], onset[many], "--", color="black", label="energy of one contact")
    axes.plot(across[many], end[many], ":", color="black", label="energy of all contacts")
    axes.set(xscale="log", yscale="log", xlabel="diameter (µm)", ylabel="approach speed (m/s)")
    axes.set_ylim(SPEEDS[0], SPEEDS[-1])
    axes.set_title(f"Pairs of silica aggregates, {SURFACE_ENERGY:g} J/m²")
    figure.legend(loc="outside right upper")
    figure.draw_without_rendering()
    finish(axes)
    figure.savefig(HERE / "regimes.png", dpi=DOTS_PER_INCH)


if __name__ == "__main__":
    main()
