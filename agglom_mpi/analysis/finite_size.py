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

from agglom_mpi.analysis.estimates import kept, objective_at, objective_of
from agglom_mpi.analysis.extrapolation import Extrapolation, Value, extrapolated
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.tables import table_of_entries, time_on_free_core
from agglom_mpi.formatting import value_with_error
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.statistics import MeanEstimate, mean_of, too_many_failed

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.storage.reader import CampaignData

MIN_LEFT: Final = 8.0
"""Minimum mean number of particles left in the volumes that a limit rests on.

Means of [A] row 1 follow a parabola in 1/N from 100 grains on, of which 11.8 are left. With 50
grains (6.3 left), and more so with 25 (3.7 left), they are above it.
"""


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
    left
        Mean number of particles left at the end.
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
    left: float
    growth: MeanEstimate
    objective: MeanEstimate | None
    spread: float
    seconds: float


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
        None without a limit, or where it needs code that is not run.
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
            most = abs(shift.value) + max(2.0 * shift.error, shift.half_width)
            return f"not resolved: at most {most:.2g} at 95 %"
        if not self.exceeds:
            return "within the standard error"
        times, grains = abs(shift.value) / error, self.volumes[0].grains
        return f"{times:.1f} times the standard error of the mean with {grains:,} grains"

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        fit, objective = self.growth, self.objective or Value(math.nan, math.nan, 0)
        return {
            **_with_error("limit", fit.limit),
            "limit_half_width": fit.limit.half_width,
            **_with_error("shift", fit.shift),
            "exceeds": self.exceeds,
            "chi_square": fit.chi_square,
            "p_value": fit.p_value,
            "parabola_p_value": fit.parabola_p_value,
            "why_no_limit": why_no_limit(self.volumes, fit),
            **_with_error("curvature", fit.curvature),
            **_with_error("limit_objective", objective),
            "enough_grains": self.enough_grains,
            "volumes": [_volume_entry(means) for means in self.volumes],
        }


def _with_error(name: str, number: MeanEstimate) -> dict[str, float]:
    return {name: number.value, f"{name}_standard_error": number.error}


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


@kept
def finite_sizes(data: "CampaignData") -> dict[int, FiniteSize]:
    """Return the finite size of each string with samples in at least two volumes, by string."""
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
    growth = growth_of_many(usable)
    objective = _objective(data, string, usable) if growth.has_limit else None
    return FiniteSize(string, usable, growth, objective)


def growth_of_many(volumes: Sequence[VolumeMeans], order: int = 2) -> Extrapolation:
    """Return the extrapolation of b/b⁰ in several volumes, the campaign's own first."""
    means = [each.growth for each in volumes]
    return extrapolated([each.grains for each in volumes], means, order, _fitted(volumes))


def _fitted(volumes: Sequence[VolumeMeans]) -> list[bool]:
    return [each.left >= MIN_LEFT for each in volumes]


def why_no_limit(volumes: Sequence[VolumeMeans], fit: Extrapolation) -> str:
    """Return why means in several volumes have no limit, without an end; empty if they have one."""
    if fit.has_limit:
        return ""
    left = ", ".join(f"{each.left:.3g} with {each.grains:,} grains" for each in volumes)
    if all(_fitted(volumes)):
        return (
            f"a parabola in 1/N is rejected (p {fit.parabola_p_value:.2g}); use volumes with more "
            f"grains (particles left: {left})"
        )
    return (
        f"too few particles are left ({left}); use three volumes in which at least {MIN_LEFT:g} "
        "are left"
    )


def _means(data: "CampaignData", string: int, volume: int, rows: np.ndarray) -> VolumeMeans | None:
    """Return the means of samples of a string, with what they contribute to the objective."""
    grains, law = volume * int(data.identity["scene.particles"]), objective_at(data, string)
    means = means_of_rows(rows, volume, grains)
    if means is None:
        return None
    good = rows[rows["state"] == COMPLETED]
    return means._replace(objective=mean_of(law.influence_values(law.summaries(good))))


def means_of_rows(rows: np.ndarray, volume: int, grains: int) -> VolumeMeans | None:
    """Return the means of rows of samples, (n,), without an objective.

    None below two samples, or where too many of them failed.
    """
    good = rows[rows["state"] == COMPLETED]
    failed = len(rows) - len(good)
    if len(good) < 2 or too_many_failed(failed, len(rows)):
        return None
    return VolumeMeans(
        volume,
        grains,
        len(rows),
        failed,
        float(good["particles"].mean()),
        mean_of(good["mean_radius_ratio"]),
        None,
        float(np.std(good["mean_radius_ratio"], ddof=1)),
        float(time_on_free_core(good).mean()),
    )


def _objective(data: "CampaignData", string: int, means: Sequence[VolumeMeans]) -> Value | None:
    """Return the objective in the limit of many grains."""
    signed = [each.objective for each in means if each.objective is not None]
    if len(signed) < len(means) or not all(math.isfinite(each.value) for each in signed):
        return None
    limit = extrapolated([each.grains for each in means], signed, fitted=_fitted(means)).limit
    if objective_at(data, string).is_magnitude:
        return limit._replace(value=abs(limit.value))
    return limit


def _volume_entry(means: VolumeMeans) -> dict[str, Any]:
    objective = means.objective
    return {
        "volume": means.volume,
        "grains": means.grains,
        "samples": means.samples,
        "failed": means.failed,
        "particles_left": means.left,
        "mean_radius_ratio": means.growth.value,
        "standard_error": means.growth.error,
        "spread": means.spread,
        "objective": None if objective is None else objective.value,
        "objective_standard_error": None if objective is None else objective.error,
        "cpu_seconds": means.seconds,
    }


def volumes_table(data: "CampaignData") -> "pd.DataFrame":
    """Tabulate the means of the best strings in each control volume, one row each."""
    rows = [
        {"string": string, **entry} for string, each in _sizes(data) for entry in each["volumes"]
    ]
    return table_of_entries(rows, ["string", "volume", "grains"])


def limits_table(data: "CampaignData") -> "pd.DataFrame":
    """Tabulate the limits of the best strings for many grains, one row each, in order of rank."""
    rows = []
    for string, each in _sizes(data):
        rows.append({"string": string, "grains": each.pop("volumes")[0]["grains"], **each})
    return table_of_entries(rows, ["string", "grains", "limit", "limit_standard_error"])


def _sizes(data: "CampaignData") -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the best strings with their finite size."""
    sizes = finite_sizes(data)
    order = rank_strings(data).order if sizes else []
    yield from ((string, sizes[string].as_dict()) for string in order if string in sizes)


def describe_finite_size(data: "CampaignData", shown: Sequence[int]) -> Iterator[str]:
    """Yield notes on the finite size of the strings of a table, as lines of text.

    Parameters
    ----------
    data
        The campaign.
    shown
        Strings of the columns of the table, #1 first.
    """
    named = _named(data, shown)
    for place, size in named:
        yield f"finite size of #{place}: {describe(size)}"
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


def _named(data: "CampaignData", shown: Sequence[int]) -> list[tuple[int, FiniteSize]]:
    """Return the strings of a table that have a finite size, by their places."""
    sizes = finite_sizes(data)
    return [(place, sizes[i]) for place, i in enumerate(shown, 1) if i in sizes]


def describe(size: FiniteSize) -> str:
    """Return the finite size of a string as one line."""
    first, fit = size.volumes[0], size.growth
    own = value_with_error(first.growth.value, first.growth.error)
    text = f"mean b/b0 {own} with {first.grains:,} grains"
    if not fit.has_limit:
        return f"{text}, no limit for many: {why_no_limit(size.volumes, fit)}"
    fitted = _fitted(size.volumes)
    grains = ", ".join(
        f"{each.grains:,}" for each, counts in zip(size.volumes, fitted, strict=True) if counts
    )
    text += (
        f", {fit.limit.text} in the limit of many (95 %: ± {fit.limit.half_width:.2g}; from "
        f"{grains}); shift {fit.shift.text}, {size.verdict}"
    )
    if math.isfinite(fit.p_value):
        fits = "would fit" if fit.is_linear else "does not fit"
        text += (
            f"; the term 1/N² changes the limit by {fit.curvature.text}, 1/N alone "
            f"{fits} (χ² {fit.chi_square:.2g}, p {fit.p_value:.2g})"
        )
    if math.isfinite(fit.parabola_p_value):
        text += f"; with it the fit has p {fit.parabola_p_value:.2g}"
    return text


def finite_size_warnings(data: "CampaignData", shown: Sequence[int]) -> Iterator[str]:
    """Yield warnings of shifts above their standard errors, and of strings without a limit.

    Arguments as for `describe_finite_size`.
    """
    named = _named(data, shown)
    over = [(place, size) for place, size in named if size.exceeds]
    if over:
        place, worst = max(over, key=lambda pair: abs(pair[1].growth.shift.value))
        first, shift = worst.volumes[0], worst.growth.shift
        is_curved = math.isfinite(worst.growth.curvature.value)  # as three volumes tell
        advice = "publish the limit" if is_curved else "add a third volume"
        yield (
            f"scene.particles: with {first.grains:,} grains the mean b/b0 of "
            f"#{place}{_others(over)} is {value_with_error(abs(shift.value), shift.error)} "
            f"{'above' if shift.value > 0.0 else 'below'} its limit for many grains, "
            f"{worst.verdict}; {advice}, or use {worst.enough_grains:,} grains, where the shift is "
            "about the present standard error"
        )
    without = [(place, size) for place, size in named if not size.growth.has_limit]
    if without:
        place, size = without[0]
        yield (
            f"final.volumes: the mean b/b0 of #{place}{_others(without)} has no limit for many "
            f"grains: {why_no_limit(size.volumes, size.growth)}"
        )


def _others(named: Sequence[tuple[int, FiniteSize]]) -> str:
    return f" (and of {len(named) - 1} more)" if len(named) > 1 else ""
