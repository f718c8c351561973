"""Whether a posterior of all data can be trusted on its own question: by made-up measurements.

Simulation-based calibration (Talts et al., arXiv:1804.06788): a truth is drawn, the data are made
up from it, and the posterior of these data is computed. Over many such data sets, the truth's rank
in the posterior is uniform, and 90 % ranges cover 90 % of the truths.

A made-up data set has its own campaign. A function drawn from the emulator takes the place of the
simulation: it gives the mean of every string. Each string's samples scatter about it as its own
do: their deviations are drawn anew, with replacement, so that their noise is as skewed and as
correlated as it is. The emulator then rests on these samples; its covariance is not fitted again,
and failed strings stay the same. What this leaves out, a true function that differs from those
drawn, is checked by held-out strings near the data.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.stats import kstest, kstwo

from agglom_mpi.formatting import format_digits
from agglom_mpi.inference.calibration import MAX_COVERAGE, MIN_COVERAGE, Region, region_of
from agglom_mpi.inference.data_emulator import (
    CALIBRATION_STREAM,
    EmulatedData,
    chi_squares,
    log_densities,
)
from agglom_mpi.inference.posterior_sampling import CENTRAL, WeightedStrings, effective_size
from agglom_mpi.statistics import Floats

DATA_SETS: Final = 200
"""Number of data sets that are made up."""
CALIBRATION_POINTS: Final = 4096
"""Maximum mean number of strings that stand for the posterior of a made-up data set."""
TEMPERATURE: Final = 4.0
"""Truths have the density of the posterior to the power of one over this: twice as wide."""
DATA_SETS_AT_ONCE: Final = 16
"""Number of data sets whose densities are computed together."""
NEAR_STRINGS: Final = 50
"""Number of held-out strings that are compared: those with the smallest χ² of the data."""
MIN_RANGE_COVERAGE: Final = 0.82
"""Minimum coverage of the 90 % ranges of a variable: four standard errors less than expected."""
MIN_UNIFORMITY: Final = 1e-3
"""Minimum p-value of the ranks of a variable, times the number of variables."""


class DataCalibration(NamedTuple):
    """How well posteriors of made-up data contain their truths.

    Attributes
    ----------
    names
        Of the d searched variables.
    ranks
        Share of each posterior below the truth, shape (data sets, d).
    effective_size
        Median effective number of strings of these posteriors.
    near
        Accuracy of the emulator at the held-out strings nearest to the data; None without one.
    """

    names: tuple[str, ...]
    ranks: Floats
    effective_size: float
    near: Region | None

    @property
    def coverage(self) -> dict[str, float]:
        """Share of the truths in the central 90 % of their posteriors, by variable."""
        inside = (self.ranks >= CENTRAL[0]) & (self.ranks <= CENTRAL[1])
        return dict(zip(self.names, inside.mean(axis=0).tolist(), strict=True))

    @property
    def standard_error(self) -> float:
        """Standard error of each coverage, where it is 90 %."""
        share = CENTRAL[1] - CENTRAL[0]
        return math.sqrt(share * (1.0 - share) / len(self.ranks))

    @property
    def uniformity(self) -> dict[str, float]:
        """Probability of less uniform ranks by chance (Kolmogorov and Smirnov), by variable.

        A rank among few strings errs itself, and the strings are the same for all data sets. So the
        test is that of two samples: the truths, and the effective number of strings.
        """
        sizes = len(self.ranks), self.effective_size
        number = max(1, round(sizes[0] * sizes[1] / sum(sizes)))
        found = (kstwo.sf(kstest(ranks, "uniform").statistic, number) for ranks in self.ranks.T)
        return dict(zip(self.names, map(float, found), strict=True))

    @property
    def worst(self) -> tuple[str, float]:
        """The variable with the smallest coverage, and that coverage."""
        return min(self.coverage.items(), key=lambda item: item[1])

    @property
    def reasons(self) -> list[str]:
        """Faults of the posterior; empty if it is calibrated."""
        found, (name, covered) = [], self.worst
        if covered < MIN_RANGE_COVERAGE:
            found.append(
                f"90 % ranges of {name} hold {_percent(covered)} of the truths of made-up data, at "
                f"least {100 * MIN_RANGE_COVERAGE:.0f} % is needed"
            )
        if self.near is not None and self.near.coverage < MIN_COVERAGE:
            found.append(
                f"90 % intervals of the emulator hold {_percent(self.near.coverage)} of the "
                f"{self.near.strings} held-out strings nearest to the data, at least "
                f"{100 * MIN_COVERAGE:.0f} % is needed"
            )
        for each, probability in self.uniformity.items():
            uneven = probability * len(self.names) < MIN_UNIFORMITY
            if uneven and MIN_RANGE_COVERAGE <= self.coverage[each] <= MAX_COVERAGE:
                found.append(f"ranks of {each} are not uniform, p = {probability:.2g}")
        return found

    @property
    def passed(self) -> bool:
        """Whether the posterior is calibrated: its ranges are not too narrow, nor its ranks off."""
        return not self.reasons

    @property
    def text(self) -> str:
        """One-line verdict, without a full stop."""
        if self.reasons:
            return f"the posterior is not calibrated: {'; '.join(self.reasons)}"
        coverages = self.coverage.values()
        least, most = min(coverages), max(coverages)
        shares = _percent(least) if least == most else f"{100 * least:.3g} to {_percent(most)}"
        start = "are calibrated" if least <= MAX_COVERAGE else "know more than they claim"
        emulator = (
            "no emulator is needed"
            if self.near is None
            else (
                f"90 % intervals of the emulator hold {_percent(self.near.coverage)} of the "
                f"{self.near.strings} nearest held-out strings"
            )
        )
        return (
            f"posteriors of data that a string gives {start}: 90 % ranges hold {shares} of the "
            f"truths of {len(self.ranks)} made-up data sets (± {100 * self.standard_error:.2g} %), "
            f"ranks are uniform with p ≥ {min(self.uniformity.values()):.2g}; {emulator}"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the calibration as plain values."""
        return {
            "calibrated": self.passed,
            "verdict": self.text,
            "data_sets": len(self.ranks),
            "coverage": self.coverage,
            "coverage_standard_error": self.standard_error,
            "uniformity": self.uniformity,
            "effective_size": self.effective_size,
            "held_out_coverage": None if self.near is None else self.near.coverage,
            "held_out_strings": 0 if self.near is None else self.near.strings,
        }


def calibrate_posterior(
    emulated: EmulatedData, drawn: WeightedStrings, data_sets: int = DATA_SETS
) -> DataCalibration:
    """Return how well posteriors of data that are made up near the measured ones are calibrated.

    A posterior that fails is tested once more with other data sets: all share strings, so that
    chance makes outliers more often than the tests expect.

    Parameters
    ----------
    emulated
        The emulator.
    drawn
        The posterior of the measured data.
    data_sets
        Number of data sets to make up.
    """
    random = emulated.stream(CALIBRATION_STREAM)
    found = _calibration(emulated, drawn, data_sets, random)
    return found if found.passed else _calibration(emulated, drawn, data_sets, random)


def _calibration(
    emulated: EmulatedData, drawn: WeightedStrings, data_sets: int, random: np.random.Generator
) -> DataCalibration:
    truths, others, prior = _truths_and_others(emulated, drawn, data_sets, random)
    known = emulated.at(others)
    factors = emulated.factors(known.deviations)
    points = emulated.coordinates.of_strings(others)
    measured, values = _made_up(emulated, truths, random)
    processes, mixing = emulated.emulator.processes, emulated.emulator.mixing
    means = [e.process.means_of(values[:, :, j], points) for j, e in enumerate(processes)]
    mixed = np.stack(means, axis=-1) if means else np.empty((len(truths), len(others), 0))
    exact, own_exact = emulated.exact_numbers(others), emulated.exact_numbers(truths)
    own_exact = own_exact + random.normal(size=own_exact.shape)
    places, own = emulated.box.space.to_unit(others), emulated.box.space.to_unit(truths)
    ranks, sizes = np.empty(own.shape), np.empty(len(truths))
    for i in range(0, len(truths), DATA_SETS_AT_ONCE):
        some = slice(i, i + DATA_SETS_AT_ONCE)
        away = measured[some, None] - mixed[some] @ mixing.T
        logarithms = log_densities(away, factors, known.failing) + np.log(prior)
        logarithms -= 0.5 * np.sum((own_exact[some, None] - exact) ** 2, axis=2)
        weights = np.exp(logarithms - logarithms.max(axis=1, keepdims=True))
        weights /= weights.sum(axis=1, keepdims=True)
        ranks[some] = np.einsum("rm,rmd->rd", weights, places[None] < own[some, None])
        sizes[some] = [effective_size(each) for each in weights]
    size = float(np.median(sizes))
    return DataCalibration(emulated.box.names, ranks, size, _nearest_region(emulated))


def _percent(share: float) -> str:
    return f"{format_digits(100.0 * share, 3)} %"


def _truths_and_others(
    emulated: EmulatedData, drawn: WeightedStrings, count: int, random: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    """Return the strings that truths are, (count, k), others, (m, k), and their weights, (m,).

    Both stand for the same density, though a truth is none of the strings that it is compared with:
    each string is weighed by its probability to be on its side. Data can only have come from a
    string whose samples do not fail.
    """
    weights = drawn.weights ** (1.0 / TEMPERATURE)
    chance = np.minimum(0.5, CALIBRATION_POINTS / weights.sum() * weights)
    other = random.random(len(weights)) < chance
    failing = emulated.failing(emulated.coordinates.of_strings(drawn.strings))
    alive = np.where(other, 0.0, weights * (1.0 - failing) / (1.0 - chance))
    truths = random.choice(len(alive), count, p=alive / alive.sum())
    return drawn.strings[truths], drawn.strings[other], weights[other] / chance[other]


def _made_up(
    emulated: EmulatedData, truths: Floats, random: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return made-up data, (R, k), and mixed means of all strings of their campaigns, (R, n, k)."""
    if not emulated.emulator.processes:
        return np.empty((len(truths), 0)), np.empty((len(truths), 0, 0))
    emulator, count = emulated.emulator, len(truths)
    strings = emulator.processes[0].data.points
    at = np.concatenate((strings, emulated.coordinates.of_strings(truths)))
    functions = np.stack([e.draw(count, random)(at) for e in emulator.processes], axis=-1)
    own = functions[np.arange(count), len(strings) + np.arange(count)]
    measured = own @ emulator.mixing.T + random.normal(size=own.shape)
    return measured, functions[:, : len(strings)] + _noise(emulated, count, random)


def _noise(emulated: EmulatedData, count: int, random: np.random.Generator) -> Floats:
    """Return the noise of the mixed means of all strings, drawn anew, (count, n, k).

    Deviations of the samples of a string from their mean are drawn with replacement; those of a
    string with one sample are normal, with the variance that the emulator has for it.
    """
    emulator, mixing = emulated.emulator, emulated.emulator.mixing
    points, which = np.unique(emulated.points, axis=0, return_inverse=True)
    mixed = np.linalg.solve(mixing, emulated.samples.T).T
    order = np.argsort(which.ravel(), kind="stable")
    groups = np.split(mixed[order], np.cumsum(np.bincount(which.ravel()))[:-1])
    found = np.empty((count, len(groups), mixed.shape[1]))
    single = np.array([len(group) == 1 for group in groups])
    if single.any():
        deviations = np.column_stack([e.noise(points[single]) for e in emulator.processes])
        found[:, single] = deviations * random.normal(size=(count, *deviations.shape))
    for i in np.flatnonzero(~single):
        n = len(groups[i])
        away = (groups[i] - groups[i].mean(axis=0)) * math.sqrt(n / (n - 1.0))
        found[:, i] = away[random.integers(n, size=(count, n))].mean(axis=1)
    return found


def _nearest_region(emulated: EmulatedData) -> Region | None:
    """Return the accuracy of the emulator at the held-out strings nearest to the data."""
    if not emulated.emulator.processes:
        return None
    held_out = emulated.emulator.held_out
    means = np.column_stack([predicted for _, predicted, _ in held_out])
    deviations = np.column_stack([deviation for *_, deviation in held_out])
    scores = np.array([(mean - at) / deviation for mean, at, deviation in held_out])
    away = emulated.measured - means @ emulated.emulator.mixing.T
    chi = chi_squares(away[None], emulated.factors(deviations))[0]
    near = np.argsort(chi, kind="stable")[:NEAR_STRINGS]
    return region_of("nearest to the data", scores[:, near])
