"""A small campaign with measured data: sizes at two times, from a file and as numbers."""

MEASURED = """
title: What made these sizes?
seed: 1
scene:
  particles: 40
  grain_diameter: 100 um
  velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
  restitution: {law: constant, value: 0}
  heating: none
  end_time: 5 ms
variables:
  relative_speed: [0.01, 0.3, log]
  volume_fraction: [0.03, 0.2, log]
  density: 2000
data:
  - {quantity: sizes, file: sieve.csv, weight: mass, error: 0.05, time: 2 ms}
  - {quantity: mean_diameter, value: 130 um, error: 3 um}
  - {quantity: particles_left, value: 0.35, error: 0.05}
objective: {law: misfit}
search: {population: 6, parents: 2}
ensemble: {rule: fixed, samples: 3}
stopping: {generations: 3}
final: {strings: 2, samples: 6}
"""
SIEVE = "sieve (um);passing (%)\n120;40\n160;75\n200;100\n"


def write_measured(folder, **changes):
    """Write the campaign `measured.yaml` and its file of sizes, with parts of the text replaced."""
    text = MEASURED
    for old, new in changes.values():
        assert old in text
        text = text.replace(old, new)
    (folder / "sieve.csv").write_text(SIEVE)
    path = folder / "measured.yaml"
    path.write_text(text)
    return path
