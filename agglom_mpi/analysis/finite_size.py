"""Finite size of the answer: the best strings in larger control volumes, and for many grains.

`final: {volumes: [1, 2, 4]}` estimates the best strings in these multiples of the campaign's box,
with as many times the grains, of the same size and volume fraction. Their means are extrapolated in
1/N (`extrapolation`). An objective that contains the number of grains itself, as Π = |1 - b/b*|
[B 7.1] by b* = b⁰ N^⅓, would tend to 1 by its definition; in all volumes, and in the limit, it is
evaluated with the campaign's own number, so that only the growth changes.
"""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.analysis.estimates import objective_at, objective_of
from agglom_mpi.analysis.extrapolation import Extrapolation, Value, extrapolated
from agglom_mpi.analysis.tables import time_on_free_core
from agglom_mpi.formatting import value_with_error
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.statistics import MeanEstimate, mean_of

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

MAX_FAILED: Final = 0.1
"""Maximum fraction of failed samples of a volume that counts, as of a string."""


class VolumeMeans(NamedTuple):
    """Fresh samples of a string in one control volume.

    Attributes
    ----------
    volume
        Relative to the campaign's box.
    grains
        Number of grains N at the start.
    samples, failed
        All of them, and those that failed, which are left out of the means.
    growth
        Mean of b/b⁰.
    objective
        Mean of the samples' contributions to the objective, signed where that is the magnitude of a
        mean; None where it needs code that is not run.
    spread
        Standard deviation of b/b⁰ of a sample.
    seconds
        Mean processor time of a sample, in s.
    """

    volume: int
    grains: int
    samples: int
    failed: int
    growth: MeanEstimate
    objective: MeanEstimate | None
    spread: float
    seconds: float

    @property
    def cost(self) -> float:
        """Processor time for a standard error of 1 of b/b⁰: time × variance of a sample, in s."""
        return self.seconds * self.spread**2


class FiniteSize(NamedTuple):
    """Means of a string in several volumes, and their limit for many grains.

    Attributes
    ----------
    string
    volumes
        Means in each volume, the campaign's own first.
    growth
        Extrapolation of the mean of b/b⁰.
    objective
        Objective in the limit of many grains, evaluated with the campaign's own number of them;
        None where it needs code that is not run.
    """

    string: int
    volumes: tuple[VolumeMeans, ...]
    growth: Extrapolation
    objective: Value | None

    @property
    def quoted(self) -> MeanEstimate:
        """Mean of b/b⁰ in the campaign's own volume."""
        return self.volumes[0].growth

    @property
    def exceeds(self) -> bool:
        """Whether the shift by the finite size is resolved and above the standard error."""
        shift = self.growth.shift
        return shift.is_resolved and abs(shift.value) > self.quoted.error

    @property
    def enough_grains(self) -> int:
        """Number of grains with which the shift is at most the present standard error.

        It is the campaign's own where no larger shift is resolved, and rounded up to two digits.
        """
        own = self.volumes[0].grains
        if not self.exceeds:
            return own
        return enough_grains(own, self.growth, self.quoted.error)

    @property
    def verdict(self) -> str:
        """Comparison of the shift with the standard error, without an end."""
        shift, error = self.growth.shift, self.quoted.error
        if not shift.is_resolved:
            return f"not resolved: at most {abs(shift.value) + 2.0 * shift.error:.2g} at 95 %"
        if not self.exceeds:
            return "within the standard error"
        return f"{abs(shift.value) / error:.1f} times the standard error"

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        fit, objective = self.growth, self.objective
        found = {
            "limit": fit.limit.value,
            "limit_standard_error": fit.limit.error,
            "shift": fit.shift.value,
            "shift_standard_error": fit.shift.error,
            "exceeds": self.exceeds,
            "chi_square": fit.chi_square,
            "p_value": fit.p_value,
            "curvature": fit.curvature.value,
            "curvature_standard_error": fit.curvature.error,
            "limit_objective": math.nan if objective is None else objective.value,
            "limit_objective_standard_error": math.nan if objective is None else objective.error,
            "enough_grains": self.enough_grains,
        }
        return found | {"volumes": [_volume_entry(means) for means in self.volumes]}


def enough_grains(own: int, fit: Extrapolation, error: float) -> int:
    """Return the number of grains whose shift is at most an error, rounded up to two digits.

    The shift at N grains is slope/N; where the measured one is larger, it is the measured one that
    falls as 1/N. `own` is the number of grains of that one.
    """
    if not error > 0.0:
        return own
    wanted = max(abs(fit.slope.value), own * abs(fit.shift.value)) / error
    step = 10 ** max(0, math.floor(math.log10(max(1.0, wanted))) - 1)
    return max(own, step * math.ceil(wanted / step))


def finite_sizes(data: "CampaignData") -> dict[int, FiniteSize]:
    """Return the finite size of each string with samples in at least two volumes, by string."""
    return data.derived(_finite_sizes) if data.volumes else {}


def _finite_sizes(data: "CampaignData") -> dict[int, FiniteSize]:
    strings = sorted(
        {int(i) for volume in data.volumes for i in np.unique(data.volume_rows(volume)["string"])}
    )
    known = data.parameters
    found = (_finite_size(data, string) for string in strings if string in known)
    return {each.string: each for each in found if each is not None}


def _finite_size(data: "CampaignData", string: int) -> FiniteSize | None:
    rows = {1: data.fresh_samples} | {v: data.volume_rows(v) for v in data.volumes}
    means = [_means(data, string, v, each[each["string"] == string]) for v, each in rows.items()]
    usable = tuple(each for each in means if each is not None)
    if len(usable) < 2 or usable[0].volume != 1:
        return None
    grains = [each.grains for each in usable]
    growth = extrapolated(grains, [each.growth for each in usable])
    return FiniteSize(string, usable, growth, _objective(data, string, grains, usable))


def _means(data: "CampaignData", string: int, volume: int, rows: np.ndarray) -> VolumeMeans | None:
    """Return the means of samples of a string, with what they contribute to the objective."""
    grains, law = volume * int(data.identity["scene.particles"]), objective_at(data, string)
    means = means_of_rows(rows, volume, grains)
    if means is None:
        return None
    good = rows[rows["state"] == COMPLETED]

    def signed() -> MeanEstimate:
        return mean_of(law.influence_values(law.summaries(good)))

    found = data.unless_code("objectives in larger volumes", signed, None)
    return means._replace(objective=found)


def means_of_rows(rows: np.ndarray, volume: int, grains: int) -> VolumeMeans | None:
    """Return the means of rows of samples, (n,), without an objective.

    None below two samples, or where more than `MAX_FAILED` of them failed.
    """
    good = rows[rows["state"] == COMPLETED]
    failed = len(rows) - len(good)
    if len(good) < 2 or failed > MAX_FAILED * len(rows):
        return None
    return VolumeMeans(
        volume,
        grains,
        len(rows),
        failed,
        mean_of(good["mean_radius_ratio"]),
        None,
        float(np.std(good["mean_radius_ratio"], ddof=1)),
        float(time_on_free_core(good).mean()),
    )


def _objective(
    data: "CampaignData", string: int, grains: Sequence[int], means: Sequence[VolumeMeans]
) -> Value | None:
    """Return the objective in the limit of many grains."""
    signed = [each.objective for each in means if each.objective is not None]
    if len(signed) < len(means) or not all(math.isfinite(each.value) for each in signed):
        return None
    value, error = extrapolated(grains, signed).limit
    if objective_at(data, string).is_magnitude:
        value = abs(value)
    return Value(value, error)


def _volume_entry(means: VolumeMeans) -> dict[str, Any]:
    objective = means.objective
    return {
        "volume": means.volume,
        "grains": means.grains,
        "samples": means.samples,
        "failed": means.failed,
        "mean_radius_ratio": means.growth.value,
        "standard_error": means.growth.error,
        "spread": means.spread,
        "objective": None if objective is None else objective.value,
        "objective_standard_error": None if objective is None else objective.error,
        "cpu_seconds": means.seconds,
    }


def describe_finite_size(data: "CampaignData", shown: Sequence[int]) -> Iterator[str]:
    """Yield notes on the finite size of the strings of a table, as lines of text.

    Parameters
    ----------
    data
        The campaign.
    shown
        Strings of the columns of the table, #1 first.
    """
    sizes = finite_sizes(data)
    named = [(f"#{place}", sizes[i]) for place, i in enumerate(shown, 1) if i in sizes]
    for name, size in named:
        yield f"finite size of {name}: {describe(size)}"
    if not named:
        return
    yield (
        "limits are of mean b/b0 = limit + slope/N, and a term 1/N² with three volumes or more; "
        "with two its effect is unknown"
    )
    if objective_of(data).counts_grains:
        grains = named[0][1].volumes[0].grains
        yield (
            f"the objective contains the number of grains: in all volumes it is evaluated with "
            f"{grains:,}, as by its definition it tends to 1 with the number of each volume"
        )


def describe(size: FiniteSize) -> str:
    """Return the finite size of a string as one line."""
    first, fit = size.volumes[0], size.growth
    grains = ", ".join(f"{each.grains:,}" for each in size.volumes)
    own = value_with_error(first.growth.value, first.growth.error)
    text = (
        f"mean b/b0 {own} with {first.grains:,} grains, {value_with_error(*fit.limit)} in the "
        f"limit of many (from {grains}); shift {value_with_error(*fit.shift)}, {size.verdict}"
    )
    if math.isfinite(fit.p_value):
        fits = "would fit" if fit.is_linear else "does not fit"
        text += (
            f"; the term 1/N² changes the limit by {value_with_error(*fit.curvature)}, 1/N alone "
            f"{fits} (χ² {fit.chi_square:.2g}, p {fit.p_value:.2g})"
        )
    return text


def finite_size_warnings(data: "CampaignData", shown: Sequence[int]) -> Iterator[str]:
    """Yield a warning if the shift of a string exceeds its standard error; arguments as above."""
    sizes = finite_sizes(data)
    over = [
        (place, sizes[i]) for place, i in enumerate(shown, 1) if i in sizes and sizes[i].exceeds
    ]
    if not over:
        return
    place, worst = max(over, key=lambda pair: abs(pair[1].growth.shift.value))
    first, shift = worst.volumes[0], worst.growth.shift
    others = f" (and of {len(over) - 1} more)" if len(over) > 1 else ""
    yield (
        f"scene.particles: with {first.grains:,} grains the mean b/b0 of #{place}{others} is "
        f"{value_with_error(abs(shift.value), shift.error)} "
        f"{'above' if shift.value > 0.0 else 'below'} its limit for many grains, {worst.verdict}; "
        f"publish the limit, or use {worst.enough_grains:,} grains, where the shift is about the "
        "present standard error"
    )
