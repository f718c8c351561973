"""Means over samples of the quantities of functions and of spins, of each string."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import completed_rows
from agglom_mpi.outcome import quantity_columns
from agglom_mpi.statistics import MeanEstimate, mean_of

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

MEASURED_ON: Final = "as searched", "re-estimate"
"""Labels of the two means: over the samples that decisions rest on, and over fresh ones."""


def quantity_means(data: "CampaignData", string: int) -> dict[str, tuple[MeanEstimate, ...]]:
    """Return the mean of each quantity over the samples used of a string, and the fresh ones.

    Failed samples are left out. The dictionary is empty where there are no quantities.
    """
    names = list(data.sizes.quantities)
    if not names:
        return {}
    used, fresh = (completed_rows(data, string, fresh) for fresh in (False, True))
    return {name: (mean_of(used[name]), mean_of(fresh[name])) for name in names}


def as_entries(data: "CampaignData", string: int) -> dict[str, Any]:
    """Return the `quantities` of a string by name, for JSON: means, standard errors and units."""
    return {
        name: {
            "mean": used.value,
            "standard_error": used.error,
            "estimate": fresh.value,
            "estimate_standard_error": fresh.error,
            "unit": data.sizes.quantities[name],
        }
        for name, (used, fresh) in quantity_means(data, string).items()
    }


def quantity_table(
    data: "CampaignData", strings: Iterable[int], fresh: bool
) -> dict[str, tuple[NDArray[np.float64], str]]:
    """Return columns of means and standard errors for n strings: values, (n,), and unit, by name.

    Parameters
    ----------
    data
    strings
    fresh
        Whether the means are over fresh samples, and not over those that results rest on.
    """
    found = [quantity_means(data, string) for string in strings] if data.sizes.quantities else []
    table: dict[str, tuple[NDArray[np.float64], str]] = {}
    for name, unit in data.sizes.quantities.items():
        means = [each[name][int(fresh)] for each in found]
        own = quantity_columns(name)[2 * fresh :]
        table[own[0]] = np.array([mean.value for mean in means], np.float64), unit
        table[own[1]] = np.array([mean.error for mean in means], np.float64), unit
    return table
