"""Properties of objectives and stopping rules, on made-up samples of a string."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.contracts.cases import Violation, equal, within
from agglom_mpi.outcome import COMPLETED, OUTCOME, SampleSummary, summaries
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.objectives.growth import GrowthTarget
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.search.stopping import EnsembleState, StoppingRule, rows_of

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
        for name, text in _wrong_estimates(objective, made_up_rows(seed + string, 2 + string)):
            if text:
                yield name, f"{text}; of {2 + string} made-up samples"


def _wrong_estimates(
    objective: Objective, rows: NDArray[np.void]
) -> Iterator[tuple[str, Violation]]:
    """Yield the properties of the objective of some samples, and what is wrong, if anything."""
    samples = summaries(rows)
    value, error = objective.of_ensemble(samples)
    if not (math.isfinite(value) and math.isfinite(error) and error >= 0.0):
        yield "finite", f"the objective is {value} +- {error}"
        return
    yield "least", within("the objective", value, objective.least, math.inf)
    values = np.asarray(objective.influence_values(samples))
    if values.shape != (len(samples),):
        yield "mean", f"influence values have the shape {values.shape}"
    mean = abs(float(values.mean())) if objective.is_magnitude else float(values.mean())
    size = SUM_ROUNDING * max(abs(value), float(np.abs(values).max()))
    rough = size + 1e-6 * error
    yield "mean", equal("the mean of influence values", mean, value, size)
    spread = float(values.std(ddof=1)) / math.sqrt(len(values))
    yield "error", equal("the standard error of influence values", spread, error, rough)
    turned = objective.of_ensemble(samples[::-1])
    yield "order", equal("the objective in the other order", turned[0], value, size)
    yield "order", equal("the standard error in the other order", turned[1], error, rough)
    alone = np.array([objective.of_ensemble([sample])[0] for sample in samples])
    single = np.asarray(objective.of_samples(rows))
    if single.shape != alone.shape or np.abs(single - alone).max() > size:
        yield "single", "of_samples and the accumulator differ for samples that are alone"
    signed = objective.signed(value, float(rows["mean_radius_ratio"].mean()))
    yield "signed", equal("the magnitude of signed", abs(signed), abs(value), size)


def made_up_states(seed: int) -> EnsembleState[Any]:
    """Return the states of made-up ensembles after each sample, shape (samples, ensembles)."""
    random = np.random.default_rng(seed)
    count = np.arange(1, MADE_UP_SAMPLES + 1)[:, None]
    objectives = random.normal(1.0, 0.2, (MADE_UP_SAMPLES, MADE_UP_STRINGS))
    moments = random.lognormal(0.0, 0.3, (4, *objectives.shape)).cumsum(axis=1) / count
    mean = objectives.cumsum(axis=0) / count
    spread = np.sqrt(np.maximum((objectives**2).cumsum(axis=0) / count - mean**2, 0.0))
    error = np.where(count > 1, spread / np.sqrt(np.maximum(count - 1, 1)), np.nan)
    return EnsembleState(count, moments[0], mean, error, (moments[1], moments[2], moments[3]))


def _of_one(states: EnsembleState[Any], string: int) -> EnsembleState[Any]:
    """Return the states of one ensemble among many."""
    count, *means, moments = states
    one, two, three, *others = (each[:, [string]] for each in (*(moments or ()), *means))
    return EnsembleState._make((count, *others, (one, two, three)))


def rule_failures(rule: StoppingRule, seed: int) -> Iterator[tuple[str, str]]:
    """Yield each property of a stopping rule that does not hold, and what is wrong.

    A rule depends on two successive states alone: of one ensemble or of many, now or later, and
    whatever comes after them. It ends every ensemble within its limits.
    """
    states, half = made_up_states(seed), MADE_UP_SAMPLES // 2
    together = rule.satisfied_paths(states)
    alone = [rule.satisfied_paths(_of_one(states, each)) for each in range(MADE_UP_STRINGS)]
    if not np.array_equal(np.hstack(alone), together):
        yield "elementwise", "holds differs for an ensemble alone and among others"
    if not np.array_equal(rule.satisfied_paths(states), together):
        yield "repeatable", "holds decides otherwise when it is asked again"
    begun = rule.satisfied_paths(rows_of(states, slice(half)))
    if not np.array_equal(begun, together[:half]):
        yield "past", f"decisions up to sample {half} depend on samples after it"
    looser = rule
    if "tolerance" in rule.model_fields:
        looser = rule.model_copy(update={"tolerance": LOOSER * rule.tolerance})
    objective = GrowthTarget(ratio=1.5)
    for string in range(MADE_UP_STRINGS):
        samples = summaries(made_up_rows(seed + string))
        used, fewer = (_used(each, objective, samples) for each in (rule, looser))
        if not rule.min_samples <= used <= rule.max_samples and used < len(samples):
            yield "limits", f"string {string} uses {used} samples"
        if fewer > used:
            text = f"string {string} uses {used} samples, and {fewer} with a larger tolerance"
            yield "tolerance", text


def _used(rule: StoppingRule, objective: Objective, samples: Sequence[SampleSummary]) -> int:
    """Return how many of the samples an ensemble uses."""
    ensemble = Ensemble(rule, objective, MADE_UP_GRAINS)
    for sample in samples:
        if not ensemble.finished:
            ensemble.add(sample)
    return ensemble.samples_used
