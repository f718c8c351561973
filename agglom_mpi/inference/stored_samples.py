"""The samples that the emulator of a file rests on, each once, and what they predict for data.

A prediction belongs to all samples of a string together: a median or a share of pooled particles.
The pseudo-values of the jackknife, n·pooled − (n − 1)·left out (Tukey 1958), share it out among the
n samples: their mean is the prediction with its bias of order 1/n removed, and the variance of
their mean is the jackknife's. They stand for numbers of independent samples, as an emulator takes
them.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.lib.recfunctions import repack_fields
from numpy.typing import NDArray

from agglom_mpi.errors import UserError
from agglom_mpi.measurements.census import Censuses, census_of, sample_count
from agglom_mpi.measurements.datum import Datum, experiments_of, predictions
from agglom_mpi.measurements.layout import census_names
from agglom_mpi.outcome import COMPLETED, FAILED
from agglom_mpi.search.proposals import MODEL, OFFSPRING
from agglom_mpi.statistics import Floats, too_many_failed
from agglom_mpi.storage.recorded_campaign import recorded_campaign
from agglom_mpi.storage.schema import LEARNED_FAVOURS_LOW, LEARNED_STRING, parameters_of
from agglom_mpi.storage.table import concatenated, fitted

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

MIN_STRINGS: Final = 50
"""Minimum number of different strings of a campaign that an emulator is made for."""


class StoredSamples(NamedTuple):
    """The different samples of a file.

    Attributes
    ----------
    strings
        Parameters of each completed sample of a string that did not fail, shape (n, k).
    rows
        These samples, shape (n,).
    tried
        Different strings that were simulated, shape (m, 10).
    failed
        Which of these have too many failed samples, shape (m,).
    """

    strings: Floats
    rows: NDArray[np.void]
    tried: Floats
    failed: NDArray[np.bool_]


def counted_samples(
    data: "CampaignData", learned: bool = True
) -> tuple[Floats, NDArray[np.void], NDArray[np.int64]]:
    """Return the counted samples of a file, and those it `learned`, each once, also failed ones.

    Equal strings have the same samples, but those that were learned have other random numbers.

    Returns
    -------
    tuple
        Different strings, (m, k), with or without samples; the samples, (n,), those that took too
        long as failed ones; and the places of their strings, (n,).
    """
    campaign, strings = recorded_campaign(data), data.string_rows()
    rows = data.counted_samples
    if len(late := _late(data)):
        rows = concatenated((rows, late), rows.dtype)
    rows = rows[np.isin(rows["string"], strings["string"])]
    order = np.argsort(strings["string"], kind="stable")
    of_row = order[np.searchsorted(strings["string"][order], rows["string"])]
    parameters = parameters_of(strings)
    # A sample of equal strings is the same where its random stream, hence its number, is the same.
    first = np.array([campaign.first_sample(int(i)) for i in strings["string"]], np.int64)
    numbers = first[of_row] + rows["sample"]
    if learned and (others := data.learned_rows()) is not None:
        more = np.arange(len(others))
        parameters = np.vstack((parameters, others[LEARNED_STRING]))
        of_row = np.concatenate((of_row, len(strings) + more))
        numbers = np.concatenate((numbers, -1 - more))  # no number of a sample of the file's own
        rows = concatenated((rows, fitted(others, rows.dtype)), rows.dtype)
    keys = np.nan_to_num(parameters)  # nan: a variable that the scene does not use
    _, one, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    samples = np.column_stack((which.ravel()[of_row], numbers))
    _, once = np.unique(samples, axis=0, return_index=True)
    return parameters[one], rows[once], samples[once, 0]


def stored_samples(data: "CampaignData") -> StoredSamples:
    """Return the counted samples of a file, and of those pooled with it, each once.

    Rows of several files have no censuses, whose classes may differ. Files of one question have
    learned the same samples, which count once.
    """
    found = [_own_samples(data), *(_own_samples(each, learned=False) for each in data.pooled)]
    if len(found) == 1:
        return found[0]
    strings, rows, tried, failed = zip(*found, strict=True)
    names = [n for n in rows[0].dtype.names or () if all(n in each.dtype.fields for each in rows)]
    plain = [name for name in names if name not in census_names(tuple(names))]
    samples = np.concatenate([repack_fields(each[plain]) for each in rows])
    return StoredSamples(np.concatenate(strings), samples, *map(np.concatenate, (tried, failed)))


def _own_samples(data: "CampaignData", learned: bool = True) -> StoredSamples:
    """Return the samples of a file that its emulator rests on."""
    different, rows, place = counted_samples(data, learned)
    completed = rows["state"] == COMPLETED
    count = np.bincount(place, minlength=len(different))
    bad = np.bincount(place[~completed], minlength=len(different))
    tried, failed = count > 0, too_many_failed(bad, count)
    good = completed & ~failed[place]
    return StoredSamples(different[place[good]], rows[good], different[tried], failed[tried])


def require_emulated(data: "CampaignData", error: type[UserError]) -> None:
    """Raise an error if the samples of a campaign cannot give an emulator of its strings."""
    campaign, why = recorded_campaign(data), ""
    if campaign.plan is None or not campaign.variables.searched:
        why = "no variable is searched, so nothing is to be inferred"
    elif campaign.common_configurations:
        why = (
            "ensemble.common_configurations is true; the noise of its strings is correlated, which "
            "the emulator does not model, so results would look surer than they are; run the "
            "campaign without them"
        )
    if why:
        raise error(f"{data.path}: {why}")


def require_strings(
    data: "CampaignData", strings: Floats, what: str, error: type[UserError]
) -> int:
    """Return how many of strings, (n, k), differ; raise an error if they are too few for `what`."""
    different = len(np.unique(np.nan_to_num(strings), axis=0))
    if different < MIN_STRINGS:
        raise error(
            f"{data.path}: results of {different} different strings; at least {MIN_STRINGS} are "
            f"needed for {what}"
        )
    return different


def favours_low_objectives(data: "CampaignData") -> bool:
    """Return whether a search for the best proposed some strings by the results of others."""
    if any(map(favours_low_objectives, data.pooled)):
        return True
    strings, search = data.string_rows(), recorded_campaign(data).search
    by_results = np.isin(strings["origin"], (OFFSPRING, MODEL))
    by_results &= strings["generation"] >= (0 if data.sizes.learned else search.lag)
    own = search.favours_low_objectives and bool(by_results.any())
    return own or bool(data.attributes.get(LEARNED_FAVOURS_LOW, False))


def _late(data: "CampaignData") -> NDArray[np.void]:
    """Return failed samples, (n,), in place of those that took too long and have no row."""
    counted = {*data.judged_timed_out} | data.fresh_timed_out
    numbers = sorted(data.timed_out if data.with_unused else counted)
    late = np.zeros(len(numbers), data.counted_samples.dtype)
    late["state"] = FAILED
    late["string"], late["sample"] = np.reshape(numbers, (-1, 2)).T
    return late


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
    prediction, are left out. Equal strings of pooled files stay apart.

    Parameters
    ----------
    file
    data
        In any order, whether they were measured or not; each at a time of the campaign's censuses.
    stored
        The samples, if they have been read already; those of pooled files are read again.

    Raises
    ------
    ValueError
        If the campaign stores no censuses, or none at the time of a datum.
    """
    if not file.pooled:
        return _own_values(file, data, stored or _own_samples(file))
    parts = [_own_values(each, data, _own_samples(each)) for each in (file, *file.pooled)]
    strings, values, lengths = zip(*parts, strict=True)
    ends = max(low for low, _ in lengths), min(high for _, high in lengths)
    return StringValues(np.concatenate(strings), np.concatenate(values), ends)


def _own_values(
    file: "CampaignData", data: Sequence[Datum], samples: StoredSamples
) -> StringValues:
    """Return the same of one file."""
    campaign, experiments = recorded_campaign(file), experiments_of(data)
    if file.sizes.census is None:
        raise ValueError(f"{file.path}: its samples have no censuses, as it has no section data")
    _, which = np.unique(np.nan_to_num(samples.strings), axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(which.ravel()))[:-1])
    found_strings, found_values, edges = [], [], list[Floats]()
    for group in groups if len(order) else ():
        measured = campaign.measured_at(samples.strings[group[0]])
        rows = samples.rows[group]
        columns = (rows[name] for name in census_names(rows.dtype.names))
        census = measured.census(list(zip(*columns, strict=True)))
        values = pseudo_values(census, data)
        if np.all(np.isfinite(values)):
            found_strings.append(samples.strings[group])
            found_values.append(values)
            edges += (census_of(census, name).edges[[0, -1]] for name in experiments)
    if not found_values:
        size = sum(len(datum.values) for datum in data)
        return StringValues(samples.strings[:0], np.empty((0, size)))
    lengths = float(np.min(edges)), float(np.max(edges))
    return StringValues(np.concatenate(found_strings), np.concatenate(found_values), lengths)


def pseudo_values(census: Censuses, data: Sequence[Datum]) -> Floats:
    """Return the pseudo-values of the n samples of a string, shape (n, Q).

    Parameters
    ----------
    census
        At least one sample, as `predictions` takes it. One sample alone has its own predictions.
    data
        In any order.
    """
    found = predictions(census, data)
    n = sample_count(census)
    if n == 1:
        return found.pooled[None]
    return np.asarray(n * found.pooled - (n - 1) * found.left_out)
