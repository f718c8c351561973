"""Warnings about the samples of a string, of a campaign file and of `agglom simulate` alike."""

from typing import Final

from agglom_mpi.formatting import pluralise

FEWEST_LEFT: Final = 10
"""Mean number of particles left below which a box is too small for statistics of its particles.

The box is then about two of their spacings wide (10^(1/3) = 2.2): the neighbours of a particle are
the images of a few others, and an impact changes the mean of b/b0 by a tenth of itself and more.
"""
EARLY: Final = 0.1
"""Fraction of the end time; changes before it are early."""
EARLY_SAMPLES: Final = 3
"""Minimum number of samples for a warning that all changes are early."""


def few_left(left: float, grains: int, of: str = "") -> list[str]:
    """Return a line if fewer than `FEWEST_LEFT` particles are left of a scene that had more.

    Parameters
    ----------
    left
        Mean number of particles left.
    grains
        Number of grains at the start.
    of
        Which string, as ` in the best string`.
    """
    if left >= FEWEST_LEFT or grains < FEWEST_LEFT:
        return []
    return [
        f"scene.particles: {left:.3g} of {grains:,} particles are left on average{of}; fewer than "
        f"{FEWEST_LEFT} make the box too small for statistics, so start with more grains, or end "
        "earlier"
    ]


def early_changes(changes: int, samples: int) -> list[str]:
    """Return the warning that all `changes`, merges and breakups, of samples are early."""
    return [
        f"scene.end_time: all {changes:,} merges and breakups of {pluralise(samples, 'sample')} "
        f"happen in the first {EARLY:g} of it; an earlier end gives the same particles"
    ]
