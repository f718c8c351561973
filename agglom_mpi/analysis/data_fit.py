"""How well a string fits the measured data of its campaign, and which datum disagrees."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import completed_rows, objective_at, objective_of
from agglom_mpi.formatting import pluralise, value_with_error
from agglom_mpi.measurements.datum import Datum, exact_values
from agglom_mpi.measurements.misfit import UNLIKELY, DatumMisfit, Misfit, sampling_noise
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.reader import CampaignData


def has_data(file: CampaignData) -> bool:
    """Return whether a campaign compares its samples with measured data."""
    return "objective.law" in file.identity and objective_of(file).needs_data


def _completed(file: CampaignData, string: int) -> NDArray[np.void]:
    """Return the completed fresh samples of a string, or those that the search used if none are."""
    fresh = completed_rows(file, string, fresh=True)
    return fresh if len(fresh) else completed_rows(file, string, fresh=False)


def data_fit(file: CampaignData, string: int) -> tuple[Misfit, int] | None:
    """Return the misfit of a string, and the number of samples that it rests on.

    These are its fresh samples if there are any, else those that the search used. None where no
    sample completed.
    """
    completed = _completed(file, string)
    if not len(completed):
        return None
    law: Any = objective_at(file, string)
    return law.misfit(law.summaries(completed)), len(completed)


StringPredictions = tuple[tuple[Datum, ...], Floats, Floats]
"""Data, what a string predicts for the values of all of them, (Q,), one datum after the other, and
the covariance of the errors of that by the jackknife over samples, (Q, Q); nan of a single one."""


def string_predictions(
    file: CampaignData, string: int, data: Sequence[Datum] | None = None
) -> StringPredictions | None:
    """Return the predictions of a string by its fresh samples, else by those that the search used.

    None where no sample completed.

    Parameters
    ----------
    file
    string
    data
        Measured or not, at the times of the campaign's censuses; None: what was measured.
    """
    completed = _completed(file, string)
    if not len(completed):
        return None
    law: Any = objective_at(file, string)
    found = law.predictions(law.summaries(completed), data)
    noise = sampling_noise(found.left_out, exact_values(data or law.data))
    covariance = noise.raw if noise.freedom else np.full(noise.raw.shape, math.nan)
    return tuple(data or law.data), found.pooled, covariance


def describe_fit(file: CampaignData, string: int) -> list[str]:
    """Return lines on the misfit of the best string, #1, and on each datum; none without data."""
    found = data_fit(file, string) if has_data(file) else None
    if found is None:
        return []
    fit, samples = found
    fits = "fits the data" if fit.p_value >= UNLIKELY else "does not fit the data"
    shown = value_with_error(fit.value, fit.standard_error)
    first = (
        f"#1 {fits} within the errors of both, p = {fit.p_value:.2g}: misfit {shown} of "
        f"{pluralise(fit.rank, 'number')}, {pluralise(samples, 'sample')}"
    )
    return [first, *(f"  {_line(part)}" for part in fit.parts)]


def _line(part: DatumMisfit) -> str:
    """Return how far the prediction of one datum is off."""
    verdict = "" if part.p_value >= UNLIKELY or math.isnan(part.p_value) else ", disagrees"
    if len(part.residual) > 1:
        counted = pluralise(part.rank, f"independent {part.datum.kind.one_value}")
        shown = f"χ² {part.chi_square:.3g} of {counted}"
    else:
        with np.errstate(divide="ignore", invalid="ignore"):
            shown = f"off by {float((part.residual / part.error)[0]):+.2g} of both errors"
    return f"{part.name}: {shown}, p = {part.p_value:.2g}{verdict}"
