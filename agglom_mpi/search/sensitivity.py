"""Which variables matter: Sobol indices of a regression of all strings that were judged.

The variance of the objective over the search box is divided among the variables (Sobol 1993): the
first-order index of one is the share that it alone explains, the total index the share in which it
plays any part (Homma and Saltelli 1996). A variable with a total index near 0 may be fixed.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.gaussian_process import GaussianProcess, fit_covariance
from agglom_mpi.search.one_thread import single_threaded
from agglom_mpi.search.streams import SENSITIVITY, stream
from agglom_mpi.search.surrogate import spread

POINTS: Final = 2048
"""Base points of the estimate, a power of two; there are d + 2 times as many in all."""

FITTED: Final = 600
"""Strings that the regression rests on at most, the best and others evenly."""

FEWEST: Final = 10
"""Strings without which nothing is said."""


class Sensitivity(NamedTuple):
    """Indices of the d variables that are searched, and how good the regression behind them is.

    Attributes
    ----------
    first_order, total : array, shape (d,)
    strings
        Strings that the regression rests on.
    explained
        Share of the variance among their objectives that it predicts when each is left out in
        turn; what is missing is noise of the samples, or what the regression does not know.
    noise
        Share that the noise of the samples has, by the regression.
    """

    first_order: NDArray[np.float64]
    total: NDArray[np.float64]
    strings: int
    explained: float
    noise: float


@single_threaded
def sensitivity(
    points: NDArray[np.float64], objectives: NDArray[np.float64], samples: NDArray[np.int64]
) -> Sensitivity | None:
    """Estimate how much each variable matters over the unit cube.

    Parameters
    ----------
    points
        Strings in units of the box, shape (n, d).
    objectives
        Finite, shape (n,).
    samples
        How many each of them rests on, shape (n,).

    Returns
    -------
    Sensitivity or None
        None if there are too few strings, or all are worth the same.
    """
    from scipy import stats

    if len(points) < FEWEST or np.ptp(objectives) == 0.0:
        return None
    some = spread(objectives, FITTED)
    known = points[some], objectives[some], samples[some]
    model = GaussianProcess(fit_covariance(*known), *known)
    indices = stats.sobol_indices(
        func=lambda x: model.mean(x.T),
        n=POINTS,
        dists=[stats.uniform()] * points.shape[1],
        random_state=stream(0, SENSITIVITY),
    )
    variance = objectives[some].var()
    missed = objectives[some] - model.left_out()
    return Sensitivity(
        first_order=np.clip(indices.first_order, 0.0, 1.0),
        total=np.clip(indices.total_order, 0.0, None),
        strings=len(some),
        explained=1.0 - float(np.mean(missed**2) / variance),
        noise=float(model.sample_deviation**2 * np.mean(1.0 / samples[some]) / variance),
    )
