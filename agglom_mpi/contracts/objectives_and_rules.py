"""Properties of objectives and stopping rules, on made-up samples of a string."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.outcome import COMPLETED, OUTCOME, SampleSummary, summaries
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.objectives.growth import GrowthTarget
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.search.stopping import EnsembleState, StoppingRule
from agglom_mpi.statistics import PooledMoments, RunningMean

MADE_UP_GRAINS: Final = 1000
"""Number of grains of the made-up samples."""
MADE_UP_SAMPLES: Final = 40
"""Number of samples of a string."""
MADE_UP_STRINGS: Final = 12
"""Number of strings."""
SUM_ROUNDING: Final = 1e-9
"""Relative rounding of sums over some ten samples, and a margin."""
LOOSER: Final = 4.0
"""Factor between a tolerance and the larger one that it is compared with."""

OBJECTIVE_PROPERTIES: Final = ("finite", "mean", "error", "order", "single", "least", "signed")
RULE_PROPERTIES: Final = ("limits", "elementwise", "past", "repeatable", "tolerance")


def made_up_rows(seed: int, count: int = MADE_UP_SAMPLES) -> NDArray[np.void]:
    """Return samples of one string, (n,), with moments of radii that really are such moments."""
    random = np.random.default_rng(seed)
    columns = [(name, OUTCOME[name]) for name in OUTCOME.names or ()]
    rows = np.zeros(count, [*columns, ("objective", np.float64)])
    rows["state"] = COMPLETED
    for row in rows:
        left = int(random.integers(20, MADE_UP_GRAINS))
        radii = random.lognormal(0.5 + 0.1 * random.standard_normal(), 0.3, left)
        away = radii - radii.mean()
        row["mean_radius_ratio"], row["particles"] = radii.mean(), left
        for order in (2, 3, 4):
            row[f"radius_moment_{order}"] = (away**order).mean()
        row["objective"] = random.normal(1.0, 0.2)
    return rows


def objective_failures(objective: Objective, seed: int) -> Iterator[tuple[str, str]]:
    """Yield each property of an objective that does not hold, and what is wrong."""
    objective = objective.of_grains(MADE_UP_GRAINS)
    for string in range(MADE_UP_STRINGS):
        rows = made_up_rows(seed + string, 2 + string)
        yield from _wrong_estimates(objective, rows)


def _wrong_estimates(objective: Objective, rows: NDArray[np.void]) -> Iterator[tuple[str, str]]:
    """Yield the properties that the objective of some samples lacks, and what is wrong."""
    samples = summaries(rows)
    at = f"of {len(samples)} made-up samples"
    value, error = objective.of_ensemble(samples)
    if not (math.isfinite(value) and math.isfinite(error) and error >= 0.0):
        yield "finite", f"the objective {at} is {value} +- {error}"
        return
    if value < objective.least:
        yield "least", f"the objective {at} is {value:.9g}, below its least, {objective.least:g}"
    values = np.asarray(objective.influence_values(samples))
    mean = abs(float(values.mean())) if objective.is_magnitude else float(values.mean())
    size = SUM_ROUNDING * max(abs(value), float(np.abs(values).max()))
    if values.shape != (len(samples),) or abs(mean - value) > size:
        yield (
            "mean",
            f"influence values {at} have the mean {mean:.9g}, the objective is {value:.9g}",
        )
    spread = float(values.std(ddof=1)) / math.sqrt(len(values))
    if abs(spread - error) > size + 1e-6 * error:
        yield "error", f"influence values {at} give +- {spread:.9g}, stated is {error:.9g}"
    turned = objective.of_ensemble(samples[::-1])
    if abs(turned[0] - value) > size or abs(turned[1] - error) > size + 1e-6 * error:
        yield "order", f"the objective {at} is {turned[0]:.9g} in the other order, not {value:.9g}"
    alone = np.array([objective.of_ensemble([sample])[0] for sample in samples])
    single = np.asarray(objective.of_samples(rows))
    if single.shape != alone.shape or np.abs(single - alone).max() > size:
        yield "single", "of_samples and the accumulator differ for samples that are alone"
    ratio = float(np.mean([sample.mean_radius_ratio for sample in samples]))
    if abs(abs(objective.signed(value, ratio)) - abs(value)) > size:
        yield "signed", f"signed gives {objective.signed(value, ratio):.9g} for {value:.9g}"


def states_of(samples: Sequence[SampleSummary], objective: Objective) -> list[EnsembleState[float]]:
    """Return the state of an ensemble after each sample."""
    ratio, radii, accumulator, states = RunningMean(), PooledMoments(), objective.accumulator(), []
    for sample in samples:
        ratio.add(sample.mean_radius_ratio)
        radii.add(sample.particles, sample.mean_radius_ratio, sample.central_moments)
        accumulator.add(sample)
        values = accumulator.value, accumulator.standard_error, radii.central
        states.append(EnsembleState(ratio.count, ratio.mean, *values))
    return states


def many(paths: list[list[EnsembleState[float]]]) -> EnsembleState[Any]:
    """Return the states of several ensembles as one, with arrays of the shape (n, ensembles)."""

    def column(get: Any) -> NDArray[np.float64]:
        return np.array([[get(state) for state in path] for path in paths]).T

    count = len(paths[0])
    central = tuple(column(lambda state, k=k: state.central_moments[k]) for k in range(3))
    return EnsembleState(
        np.arange(1, count + 1)[:, None],
        column(lambda state: state.mean_radius_ratio),
        column(lambda state: state.objective),
        column(lambda state: state.standard_error),
        (central[0], central[1], central[2]),
    )


def rule_failures(rule: StoppingRule, seed: int) -> Iterator[tuple[str, str]]:
    """Yield each property of a stopping rule that does not hold, and what is wrong.

    A rule depends on two successive states alone: of one ensemble or of many, now or later, and
    whatever comes after them. It ends every ensemble within its limits.
    """
    objective = GrowthTarget(ratio=1.5)
    strings = [summaries(made_up_rows(seed + string)) for string in range(MADE_UP_STRINGS)]
    paths = [states_of(samples, objective) for samples in strings]
    together = rule.satisfied_paths(many(paths))
    single = np.zeros_like(together)
    for string, path in enumerate(paths):
        for row in range(1, len(path)):
            single[row, string] = rule.satisfied(path[row - 1], path[row])
    if not np.array_equal(single, together):
        row, string = np.argwhere(single != together)[0].tolist()
        yield "elementwise", f"holds differs alone and among others after sample {row} of {string}"
    if not np.array_equal(rule.satisfied_paths(many(paths)), together):
        yield "repeatable", "holds decides otherwise when it is asked again"
    half = MADE_UP_SAMPLES // 2
    begun = rule.satisfied_paths(many([path[:half] for path in paths]))
    if not np.array_equal(begun, together[:half]):
        yield "past", f"decisions up to sample {half} depend on samples after it"
    for string, samples in enumerate(strings):
        used = _used(rule, objective, samples)
        if not rule.min_samples <= used <= rule.max_samples and used < len(samples):
            yield "limits", f"string {string} uses {used} samples"
    yield from _wrong_tolerance(rule, objective, strings)


def _used(rule: StoppingRule, objective: Objective, samples: Sequence[SampleSummary]) -> int:
    """Return how many of the samples an ensemble uses."""
    ensemble = Ensemble(rule, objective, MADE_UP_GRAINS)
    for sample in samples:
        if ensemble.finished:
            break
        ensemble.add(sample)
    return ensemble.samples_used


def _wrong_tolerance(
    rule: StoppingRule, objective: Objective, strings: list[list[SampleSummary]]
) -> Iterator[tuple[str, str]]:
    """Yield ensembles that take more samples with a larger tolerance."""
    if "tolerance" not in rule.model_fields:
        return
    looser = rule.model_copy(update={"tolerance": LOOSER * rule.tolerance})
    for string, samples in enumerate(strings):
        used, fewer = (_used(each, objective, samples) for each in (rule, looser))
        if fewer > used:
            text = f"string {string} uses {used} samples, and {fewer} with a larger tolerance"
            yield "tolerance", text
