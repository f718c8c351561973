"""What a laser granulometer reads of a powder before and after it was blown through a duct."""

import numpy as np

FINE = 1.0
"""Radius relative to the mean radius of the powder below which a particle counts as fine."""


def of_sample(sample):
    """Return the readings of one sample, by the names in `fines.yaml`."""
    return {
        "coarsening": volume_mean(sample.radii) / volume_mean(sample.initial_radii),
        "fines": share_of_fines(sample.radii) / share_of_fines(sample.initial_radii),
        "rate": sample.collisions / sample.end_time,
    }


def objective(means):
    """Return the squared misses of both targets: a third coarser, half of the fines left."""
    return (means["coarsening"] / 1.3 - 1.0) ** 2 + (means["fines"] / 0.5 - 1.0) ** 2


def volume_mean(radii):
    """Return the volume-weighted mean radius D[4, 3] / 2, as laser diffraction measures it."""
    return np.sum(radii**4) / np.sum(radii**3)


def share_of_fines(radii):
    """Return the share of the volume that is in fine particles."""
    return np.sum(radii[radii < FINE] ** 3) / np.sum(radii**3)
