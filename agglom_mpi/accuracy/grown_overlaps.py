"""Overlaps that the model allows: an aggregate that has grown into a neighbour which moves away.

An aggregate is larger than the spheres that bonded, so that it may reach into what is around it.
If the two approach, that is a contact at once; if they recede it is none, and they part.
"""

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.campaign import Campaign

Floats = NDArray[np.float64]

ROUNDING: Final = 1e-12
"""Overlap relative to the distance of contact up to which spheres touch, as in the ledger."""


def overlaps_part(campaign: Campaign, samples: Iterable[int]) -> bool:
    """Return whether all spheres that overlap at the end of samples recede.

    Parameters
    ----------
    campaign
        A scene with fixed variables.
    samples
        Numbers of samples that complete.
    """
    scene = campaign.at(campaign.parameters()).build(None)
    period = 2.0 * scene.half_width if campaign.scene.escape.is_periodic() else np.inf
    for sample in samples:
        frames = campaign.simulate({}, sample, frames=2).frames
        assert frames is not None
        count = int(frames.particles[-1])
        positions, velocities = frames.positions[-1][:count], frames.velocities[-1][:count]
        if approaching_overlaps(positions, velocities, frames.radii[-1][:count], period):
            return False
    return True


def approaching_overlaps(
    positions: Floats, velocities: Floats, radii: Floats, period: float
) -> int:
    """Return the number of pairs of spheres that overlap and approach each other.

    Parameters
    ----------
    positions, velocities
        In m and m/s, shape (n, 3).
    radii
        In m, shape (n,).
    period
        Edge of a periodic box in m; inf: there are no contacts across faces.
    """
    apart = positions[:, None] - positions
    if np.isfinite(period):
        apart -= period * np.round(apart / period)
    contact = radii[:, None] + radii
    overlap = np.linalg.norm(apart, axis=-1) < contact * (1.0 - ROUNDING)
    approach = np.sum(apart * (velocities[:, None] - velocities), axis=-1) < 0.0
    return int(np.triu(overlap & approach, 1).sum())
