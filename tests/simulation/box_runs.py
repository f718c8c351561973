"""Boxes for tests of the macroscale coupling: a cooling gas, and grains that do everything."""

from pathlib import Path

import numpy as np

from agglom_mpi import Box
from agglom_mpi.config.campaign import Campaign

GAS = Campaign.from_text("""
seed: 1
scene:
  particles: 200
  half_width: 1 cm
  velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
  restitution: {law: constant, value: 0.8}
  heating: none
  end_time: 1 s
variables: {relative_speed: 1, size_ratio: 0.5, density: 2500}
""")
"""Equal spheres with one restitution."""

QUICKSTART = Campaign.from_text(
    (Path(__file__).parents[2] / "jobs" / "quickstart.yaml").read_text().replace(": 100", ": 60", 1)
)
"""Sixty grains that warm and merge."""

BREAKING = Campaign.from_text("""
seed: 2
scene:
  particles: 60
  half_width: 1 cm
  velocities: {law: spread, mean: [5, 0, 0], transverse: 1}
  duration: {law: mean_speed, length_ratio: 1e-6}
  hardness: arrhenius
  friction: restitution_scaled
  reaction: contact_area
  fragmentation: pair_energy
  cooling: {law: radiation, emissivity: 0.5, surroundings: 300 K, integration: euler}
  end_time: 10 ms
  engine: {law: adaptive, floor: 1 us, ceiling: 1 ms}
variables:
  relative_speed: 10
  size_ratio: 0.6
  density: 5000
  hardness: 1e10
  heat_capacity: 500
  friction: 0.2
  temperature: 400
  activation_energy: 700
  reaction_heat: 100
  surface_energy: 3
""")
"""Grains that bounce, merge, break, react and cool."""

BOXES = {
    "gas": (GAS, "event", 2.0**-6),
    "merging, event": (QUICKSTART, "event", 2.0**-8),
    "merging, fixed": (QUICKSTART, "fixed:200", 2.0**-4),
    "breaking, event": (BREAKING, "event", 2.0**-10),
    "breaking, adaptive": (BREAKING, "adaptive", 2.0**-10),
}
"""Scene, engine and a time in s in which much happens, a power of two, so that halves are exact."""


def make(name, **given):
    campaign, engine, _ = BOXES[name]
    return Box(campaign, engine=engine, **given)


def bits(box):
    return b"".join(np.ascontiguousarray(array).tobytes() for array in box.particles)
