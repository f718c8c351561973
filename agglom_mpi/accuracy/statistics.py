"""Which samples the sections of the report compare."""

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.outcome import COMPLETED
from agglom_mpi.statistics import MeanEstimate, mean_of


def completed(rows: NDArray[np.void]) -> NDArray[np.void]:
    """Rows of samples that did not fail."""
    return rows[rows["state"] == COMPLETED]


def paired_difference(
    rows: NDArray[np.void], reference: NDArray[np.void], name: str
) -> MeanEstimate:
    """Mean of a column less that of the reference, over samples that completed in both.

    Samples of one number have the same random start, so what they share cancels.
    """
    ours, theirs = completed(rows), completed(reference)
    _, first, second = np.intersect1d(ours["sample"], theirs["sample"], return_indices=True)
    return mean_of(ours[name][first] - theirs[name][second])
