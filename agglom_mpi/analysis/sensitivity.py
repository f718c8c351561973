"""Sensitivity of the objective to each variable: Sobol indices of a regression of all strings.

The variance of the objective over the search box is divided among the variables (Sobol 1993): the
first-order index of one is the share that it alone explains, the total index the share in which it
plays any part (Homma and Saltelli 1996). A variable with a total index near 0 may be fixed.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Group, RenderableType

from agglom_mpi.analysis.estimates import rounding_of
from agglom_mpi.display.table import Column, Table
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.emulation.gaussian_process import GaussianProcess
from agglom_mpi.emulation.likelihood_fit import fit_covariance
from agglom_mpi.formatting import label_of
from agglom_mpi.random_streams import SENSITIVITY, search_stream
from agglom_mpi.search.methods.surrogate import best_and_spread
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_campaign
from agglom_mpi.storage.schema import parameters_of

POINTS: Final = 2048
"""Base points of the estimate, a power of two; it takes d + 2 times as many evaluations."""

FITTED: Final = 600
"""Most strings that the regression is fitted to: the best, and others evenly."""

FEWEST: Final = 10
"""Fewest strings that the indices are estimated from."""

LEAST_EXPLAINED: Final = 0.05
"""Least share of the variance of left-out strings that the regression must predict."""


class Sensitivity(NamedTuple):
    """Indices of the d variables that are searched, and how good the regression behind them is.

    Attributes
    ----------
    first_order, total : array, shape (d,)
    strings
        Number of strings that the regression is fitted to.
    explained
        Share of the variance among their objectives that it predicts when each is left out in
        turn; the rest is noise of the samples, or what the regression misses.
    noise
        Share of the noise of the samples in that variance, by the regression.
    """

    first_order: Floats
    total: Floats
    strings: int
    explained: float
    noise: float

    @property
    def predicts(self) -> bool:
        """Whether the regression predicts anything, so that its indices mean something."""
        return self.explained > LEAST_EXPLAINED


@single_threaded
def sensitivity(
    points: Floats,
    objectives: Floats,
    samples: NDArray[np.int64],
    rounding: float = 0.0,
) -> Sensitivity | None:
    """Estimate the Sobol indices of each variable over the unit cube.

    Parameters
    ----------
    points
        Strings in units of the box, shape (n, d).
    objectives
        Finite, shape (n,).
    samples
        Number of samples of each, shape (n,).
    rounding
        Largest difference of objectives that is rounding: they are equal.

    Returns
    -------
    Sensitivity or None
        None if there are fewer strings than `FEWEST`, or all have the same objective.
    """
    from scipy import stats

    if len(points) < FEWEST or np.ptp(objectives) <= rounding:
        return None
    some = best_and_spread(objectives, FITTED)
    known = points[some], objectives[some], samples[some]
    model = GaussianProcess(fit_covariance(*known), *known)
    indices = stats.sobol_indices(
        func=lambda x: model.mean(x.T),
        n=POINTS,
        dists=[stats.uniform()] * points.shape[1],
        random_state=search_stream(0, SENSITIVITY),
    )
    variance = objectives[some].var()
    missed = objectives[some] - model.leave_one_out()
    return Sensitivity(
        first_order=np.clip(indices.first_order, 0.0, 1.0),
        total=np.clip(indices.total_order, 0.0, None),
        strings=len(some),
        explained=1.0 - float(np.mean(missed**2) / variance),
        noise=float(model.sample_deviation**2 * np.mean(1.0 / samples[some]) / variance),
    )


def sensitivity_of(data: CampaignData) -> tuple[tuple[str, ...], Sensitivity | None]:
    """Return the searched variables of a campaign and their indices, None of too few strings.

    Strings without a finite objective are left out.
    """
    variables = recorded_campaign(data).variables
    strings, results = data.string_rows(), data.result_rows()
    _, of_string, of_result = np.intersect1d(
        strings["string"], results["string"], return_indices=True
    )
    strings, results = strings[of_string], results[of_result]
    finite = np.isfinite(results["objective"])
    points = SearchSpace.of(variables).to_unit(parameters_of(strings))
    samples = results["samples_used"] - results["failed"]
    objectives = results["objective"][finite]
    found = sensitivity(points[finite], objectives, samples[finite], rounding_of(data))
    return tuple(each.name for each in variables.own), found


def as_dict(names: tuple[str, ...], found: Sensitivity | None) -> dict[str, Any] | None:
    """Return the indices as a dictionary, for JSON; None of too few or equal strings.

    Of a regression that predicts nothing there are no `variables`.
    """
    if found is None:
        return None
    indices = zip(names, found.first_order.tolist(), found.total.tolist(), strict=True)
    shown = indices if found.predicts else ()
    return {
        "strings": found.strings,
        "explained": found.explained,
        "noise": found.noise,
        "variables": {name: {"first_order": first, "total": total} for name, first, total in shown},
    }


COLUMNS: Final = (
    Column("name", "share of the variance of the objective"),
    Column("first", "alone", format=".1%"),
    Column("total", "with others", format=".1%"),
)


def sensitivity_table(names: tuple[str, ...], found: Sensitivity | None) -> RenderableType:
    """Return a table of the variables by total index, the largest first, and notes."""
    if found is None:
        return "sensitivity: too few strings, or all of them are worth the same"
    if not found.predicts:
        return (
            f"sensitivity: no indices are given; a regression of {found.strings} strings predicts "
            f"none of the variance of strings left out ({found.explained:.0%}; at least "
            f"{LEAST_EXPLAINED:.0%} is needed)"
        )
    rows = [
        {"name": label_of(names[i]), "first": found.first_order[i], "total": found.total[i]}
        for i in np.argsort(-found.total, kind="stable").tolist()
    ]
    return Group(
        "",
        Table(COLUMNS, rows),
        f"over the search box, by a regression of {found.strings} strings; it predicts "
        f"{found.explained:.0%} of the variance of strings left out, noise of samples is "
        f"{found.noise:.0%}",
    )
