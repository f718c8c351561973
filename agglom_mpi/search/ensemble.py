"""The ensemble of one string: its samples in order, until they suffice."""

import copy
import math
from functools import cache
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.judge import HALF_WIDTH, EnsembleMeans, Judge, new_judge
from agglom_mpi.outcome import SampleSummary
from agglom_mpi.search.objectives.objective import Objective, RadiusAccumulator, RadiusObjective
from agglom_mpi.search.stopping import EnsembleState, FixedNumber, StoppingRule
from agglom_mpi.statistics import Floats, PooledMoments, RunningMean, t_95, too_many_failed

MIN_SAMPLES_TO_GIVE_UP: Final = 10
"""Fewest samples at which the share of failed ones may end an ensemble."""


class EnsembleResult(NamedTuple):
    """What the samples of a string amount to."""

    objective: float
    """Inf where no sample completed or more than 10 % failed."""
    standard_error: float
    """Of the objective, by the delta method; nan below two completed samples."""
    mean_radius_ratio: float
    """Mean of b^f/b⁰ over the completed samples; nan if there are none."""
    samples_used: int
    """Number of samples used, failed ones included: samples 0 … samples_used - 1."""
    failed: int
    hit_maximum: bool
    """Whether the largest number of samples ended it, the stopping rule not being satisfied."""
    growth_number: float
    """n^f = (mean b^f/b⁰)³ [B 7.2]."""
    mean_grains: float
    """Mean over samples of grains per particle left, which is not `growth_number`."""


class Ensemble:
    """Accumulate the samples of one string in order, until the stopping rule is satisfied.

    Failed samples are left out of every mean, and the rule is not asked after them. When they are
    more than 10 % the string ranks last, and from ten samples on the ensemble ends at once.

    Parameters
    ----------
    rule
        Limits on the samples, and the test that ends them; made after each completed sample from
        `min_samples` on.
    objective
        Accumulated over the completed samples.
    particles
        N, particles at the start of a sample.

    Attributes
    ----------
    particles
        As given.
    rule
        As given; of a resampled ensemble its fixed number.
    samples_used, failed
        Number of samples so far, and of failed ones among them.
    finished
        Whether no more samples are needed.
    """

    def __init__(self, rule: StoppingRule, objective: Objective, particles: int) -> None:
        self.max_samples = rule.max_samples
        self.samples_used = 0
        self.failed = 0
        self._before = 0, 0
        self.finished = False
        self.rule = rule
        self.particles = particles
        self._converged = False
        self._ratio = RunningMean()
        self._objective = objective.accumulator()
        self._grains = RunningMean()
        self._radii = PooledMoments()
        self._last: EnsembleState[float] | None = None  # None: not known

    def add(self, outcome: SampleSummary) -> None:
        """Add sample number `samples_used`.

        Raises
        ------
        ValueError
            If the ensemble is finished.
        """
        if self.finished:
            raise ValueError("this ensemble needs no more samples")
        self.samples_used += 1
        if outcome.completed:
            self._measure(outcome)
        else:
            self.failed += 1
        failing = self.failed > 0 and self._unreliable
        given_up = failing and self.samples_used >= MIN_SAMPLES_TO_GIVE_UP
        self.finished = self._converged or given_up or self.samples_used >= self.max_samples

    @property
    def follows_means(self) -> bool:
        """Whether completed samples may be added by `means` and `follow`, not one by one.

        Rule and objective must have a compiled form. Failed samples may end an ensemble, so that
        they and those after them are added one by one.
        """
        accumulator = self._objective
        return (
            isinstance(accumulator, RadiusAccumulator)
            and is_compiled(self.rule, accumulator.objective)
            and not (self.failed or self._before[1])
        )

    @property
    def has_judge(self) -> bool:
        """Whether whoever simulates the samples may end an ensemble that follows means."""
        return can_be_judged(self.rule, self.radius_objective)

    def judge(self, means: EnsembleMeans, samples: int) -> Judge:
        """Return the judge of an ensemble that follows means, as `judge_of`."""
        return judge_of(self.rule, self.radius_objective, self.particles, means, samples)

    @property
    def radius_objective(self) -> RadiusObjective:
        """The objective, where the ensemble follows means."""
        assert isinstance(self._objective, RadiusAccumulator)
        return self._objective.objective

    @property
    def means(self) -> EnsembleMeans:
        """The running means, where the ensemble follows them."""
        assert isinstance(self._objective, RadiusAccumulator)
        ratio, deviation = self._ratio, self._objective.mean
        return EnsembleMeans(
            ratio.count, ratio.mean, deviation.mean, deviation.squares, self._grains.mean
        )

    def follow(self, means: EnsembleMeans, converged: bool) -> None:
        """Add completed samples, at most as many as there may be.

        Parameters
        ----------
        means
            The running means with them.
        converged
            Whether the rule holds after the last of them.
        """
        assert isinstance(self._objective, RadiusAccumulator)
        self.samples_used += means.completed - self._ratio.count
        self._ratio.set(means.completed, means.ratio)
        self._objective.mean.set(means.completed, means.deviation, means.squares)
        self._grains.set(means.completed, means.grains)
        self._last = None
        self._converged = converged
        self.finished = converged or self.samples_used >= self.max_samples

    def resample(self, samples: int) -> "Ensemble":
        """Return an ensemble that continues this one with `samples` more, numbered from 0.

        Its objective, error and means are of all samples, its numbers of samples of its own.
        """
        more = copy.deepcopy(self)
        more._before = self._before[0] + self.samples_used, self._before[1] + self.failed
        more.samples_used = more.failed = 0
        more.max_samples = samples
        more.finished = more._converged = False
        more.rule = FixedNumber(samples=samples)
        return more

    @property
    def completed(self) -> int:
        """Number of completed samples, on which the objective rests."""
        return self._ratio.count

    def result(self) -> EnsembleResult:
        """Return objective, error and means of the samples so far."""
        unusable = self._unreliable or self._ratio.count == 0
        return EnsembleResult(
            objective=math.inf if unusable else self._objective.value,
            standard_error=self._objective.standard_error,
            mean_radius_ratio=self._ratio.mean,
            samples_used=self.samples_used,
            failed=self.failed,
            hit_maximum=self._hit_maximum,
            growth_number=self._ratio.mean**3,
            mean_grains=self._grains.mean,
        )

    @property
    def _hit_maximum(self) -> bool:
        at_maximum = self.samples_used >= self.max_samples
        return at_maximum and not self._converged and self.rule.is_adaptive

    @property
    def _unreliable(self) -> bool:
        samples, failed = self._before
        return too_many_failed(failed + self.failed, samples + self.samples_used)

    def _measure(self, outcome: SampleSummary) -> None:
        ratio, left = outcome.mean_radius_ratio, outcome.particles
        asks = self.rule.is_adaptive  # the objective of many samples may take long
        before = self._last or (self._state() if asks and self._ratio.count else None)
        self._ratio.add(ratio)
        self._objective.add(outcome)
        self._grains.add(self.particles / left)
        if self.rule.needs_moments:
            self._radii.add(left, ratio, outcome.central_moments)
        if not asks:
            return
        self._last = self._state()
        if before is not None and self._last.samples >= self.rule.min_samples:
            self._converged = self.rule.satisfied(before, self._last)

    def _state(self) -> EnsembleState:
        ratio, objective = self._ratio, self._objective
        central = self._radii.central if self.rule.needs_moments else None
        return EnsembleState(
            ratio.count, ratio.mean, objective.value, objective.standard_error, central
        )


def is_compiled(rule: StoppingRule, objective: Objective) -> bool:
    """Return whether rule and objective have a compiled form, a `Judge`.

    Those of one's own inherit the numbers of a judge, but not its formulas.
    """
    is_own = type(rule).own is not None or type(objective).own is not None
    is_radius = isinstance(objective, RadiusObjective) and objective.reference is not None
    return is_radius and rule.compares is not None and not is_own


def can_be_judged(rule: StoppingRule, objective: Objective) -> bool:
    """Return whether whoever simulates a string may end it: in a race others do."""
    return is_compiled(rule, objective) and rule.is_adaptive and rule.racing is None


def judge_of(
    rule: StoppingRule,
    objective: Objective,
    particles: int,
    means: EnsembleMeans,
    samples: int,
) -> Judge:
    """Return what ends a string as its ensemble does.

    Parameters
    ----------
    rule, objective, particles
        Of the ensemble; they have a compiled form.
    means
        Its running means.
    samples
        Maximum number of further samples.
    """
    assert isinstance(objective, RadiusObjective)
    judge, most = new_judge(), means.completed + samples
    judge.state[0] = (
        *(*means, particles, True, rule.compares, rule.tolerance, rule.min_samples),
        *(objective.reference, not objective.is_magnitude, False),
    )
    if rule.compares == HALF_WIDTH:
        return judge._replace(factors=_t_factors(1 << most.bit_length()))
    return judge


@cache
def _t_factors(count: int) -> Floats:
    """Return t of the 95 % interval of a mean over 0, 1, 2, … samples, (count,)."""
    return np.array([math.nan, math.nan, *(t_95(samples - 1) for samples in range(2, count))])
