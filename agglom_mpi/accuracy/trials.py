"""What an accuracy study simulates: trials, each one parameter string in one set-up."""

from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.identity import objective as objective_identity
from agglom_mpi.config.scene import Engine, SceneSection
from agglom_mpi.outcome import SampleSummary
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.stopping import EnsembleState
from agglom_mpi.variables import NAMES

MOVES_PER_STEP: Final = 25
"""What a time step or an event costs, in moves of one particle by one time step."""


class Trial(NamedTuple):
    """One parameter string, simulated a number of times in one way.

    Attributes
    ----------
    campaign : Campaign
        Its scene, seed and objective; what else it says is not used.
    parameters : array, shape (10,), SI units
    engine : Engine or None
        Instead of the scene's own.
    samples : int
        Samples to simulate.
    first_sample : int
        Number of the first of them.
    """

    campaign: Campaign
    parameters: NDArray[np.float64]
    samples: int
    engine: Engine | None = None
    first_sample: int = 0

    def identity(self) -> Iterator[tuple[str, object]]:
        """Yield all that decides the samples of the trial, flat."""
        scene = {f"scene.{key}": value for key, value in self.campaign.scene.entries().items()}
        yield from scene.items()
        yield "seed", self.campaign.seed
        yield "objective", objective_identity(self.campaign)
        yield "engine", self.engine.entries() if self.engine else None
        yield "samples", self.samples
        yield "first_sample", self.first_sample
        for name, value in zip(NAMES, self.parameters.tolist(), strict=True):
            if name in self.campaign.variables.used:
                yield f"parameters.{name}", value


def refusal(trial: Trial) -> str:
    """Why a trial's scene cannot be simulated, in words; empty if it can."""
    try:
        trial.campaign.scene.build(trial.parameters, trial.engine)
    except ValueError as error:
        return str(error)
    return ""


def with_scene(campaign: Campaign, **changes: object) -> Campaign:
    """Return the campaign with some entries of its scene replaced; `text` stays as it is."""
    scene: SceneSection = campaign.scene.model_copy(update=changes)
    return replace(campaign, scene=scene)


class _Never:
    """The rule of a trial: nothing but the number of samples ends it."""

    needs_moments: ClassVar[bool] = False

    def satisfied(self, before: EnsembleState, after: EnsembleState) -> bool:
        return False


class Quota(Ensemble):
    """A given number of samples, or fewer if they are long.

    It ends early when the samples have cost `budget`, counted in particle-steps so that the end
    does not depend on the machine, but not before `fewest` of them; and, as every ensemble, when
    most of them fail.
    """

    def __init__(self, trial: Trial, fewest: int, budget: float) -> None:
        particles = trial.campaign.scene.particles
        objective = trial.campaign.objective.build(particles)
        super().__init__(_Never(), objective, particles, 1, trial.samples)
        self._fewest = fewest
        self._left = budget

    def add(self, outcome: SampleSummary) -> None:
        """Judge one more sample."""
        super().add(outcome)
        self._left -= outcome.particle_steps + MOVES_PER_STEP * outcome.steps
        if self.samples_used >= self._fewest and self._left <= 0.0:
            self.finished = True
