"""Predictions of the samples of each string for data, as numbers of one sample each.

A prediction belongs to all samples of a string together: a median or a share of pooled particles.
The pseudo-values of the jackknife, n·pooled − (n − 1)·left out (Tukey 1958), share it out among the
n samples: their mean is the prediction with its bias of order 1/n removed, and the variance of
their mean is the jackknife's. They stand for numbers of independent samples, as an emulator takes
them.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.inference.stored_samples import StoredSamples, stored_samples
from agglom_mpi.measurements.datum import Datum, data_times, predictions
from agglom_mpi.measurements.layout import CENSUS_COLUMNS, CensusLayout
from agglom_mpi.storage.recorded_campaign import recorded_campaign

if TYPE_CHECKING:
    from agglom_mpi.measurements.census import Census
    from agglom_mpi.storage.reader import CampaignData

Floats = NDArray[np.float64]


class StringValues(NamedTuple):
    """Predicted values of the completed samples of a file, in groups of equal strings.

    Attributes
    ----------
    strings
        Parameters of each sample's string in SI units, shape (n, k).
    values
        Its pseudo-values for all values of some data, one datum after the other, in SI units,
        shape (n, Q).
    lengths
        Smallest and largest diameter in m that the classes of the censuses can tell apart.
    """

    strings: Floats
    values: Floats
    lengths: tuple[float, float] = (0.0, math.inf)


def string_values(
    file: "CampaignData", data: Sequence[Datum], stored: StoredSamples | None = None
) -> StringValues:
    """Return what the completed samples of a campaign with censuses predict for data.

    Each sample counts once, fresh or not. Strings that failed, and strings without a finite
    prediction, are left out.

    Parameters
    ----------
    file
    data
        In any order, whether they were measured or not; each at a time of the campaign's censuses.
    stored
        The samples, if they have been read already.

    Raises
    ------
    ValueError
        If the campaign stores no censuses, or none at the time of a datum.
    """
    campaign, layout = recorded_campaign(file), file.sizes.census
    if layout is None:
        raise ValueError(f"{file.path}: its samples have no censuses, as it has no section data")
    places = _places(layout, data)
    samples = stored_samples(file) if stored is None else stored
    keys = np.nan_to_num(samples.strings)  # nan: a variable that the scene does not use
    _, which = np.unique(keys, axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(which.ravel()))[:-1])
    found_strings, found_values, edges = [], [], []
    for group in groups if len(order) else ():
        measured = campaign.measured_at(samples.strings[group[0]])
        columns = (samples.rows[group][name] for name in CENSUS_COLUMNS)
        census = measured.census(list(zip(*columns, strict=True)))
        values = pseudo_values(census_at(census, places), data)
        if np.all(np.isfinite(values)):
            found_strings.append(samples.strings[group])
            found_values.append(values)
            edges.append(census.edges[[0, -1]])
    if not found_values:
        size = sum(len(datum.values) for datum in data)
        return StringValues(samples.strings[:0], np.empty((0, size)))
    lengths = float(np.min(edges)), float(np.max(edges))
    return StringValues(np.concatenate(found_strings), np.concatenate(found_values), lengths)


def pseudo_values(census: "Census", data: Sequence[Datum]) -> Floats:
    """Return the pseudo-values of the n samples of a string, shape (n, Q).

    Parameters
    ----------
    census
        At least one sample, at the times of `data_times(data)`. One sample alone has its own
        predictions.
    data
        In any order.
    """
    found = predictions(census, data)
    n = census.samples
    if n == 1:
        return found.pooled[None]
    return np.asarray(n * found.pooled - (n - 1) * found.left_out)


def census_at(census: "Census", places: Sequence[int]) -> "Census":
    """Return the same samples at some of the times of their census."""
    chosen = list(places)
    return replace(
        census,
        counts=census.counts[:, chosen],
        masses=census.masses[:, chosen],
        temperatures=census.temperatures[:, chosen],
        largest=census.largest[:, chosen],
    )


def _places(layout: CensusLayout, data: Sequence[Datum]) -> list[int]:
    """Return the places of `data_times(data)` among the times of a layout."""
    found = []
    for time in data_times(data):
        wanted = math.inf if time is None else time
        if wanted not in layout.times:
            known = ", ".join("the end" if t == math.inf else f"{t:g} s" for t in layout.times)
            asked = "the end" if time is None else f"{time:g} s"
            raise ValueError(f"no census was taken at {asked}; there are some at {known}")
        found.append(layout.times.index(wanted))
    return found
