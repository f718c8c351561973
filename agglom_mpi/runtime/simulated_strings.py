"""What all samples of a string have in common, kept for the last strings: samples come in turn."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.judge import Judge
from agglom_mpi.random_streams import key_words
from agglom_mpi.runtime.experiment import Experiment, SampleSetup
from agglom_mpi.scheduling.interface import means_of
from agglom_mpi.search.ensemble import judge_of
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.verbs.simulate import ExperimentScene, experiment_scenes, stream_key

MAX_KEPT: Final = 256
"""Maximum number of strings that are kept."""


class SimulatedString(NamedTuple):
    """How the samples of a string are simulated."""

    setup: SampleSetup
    scene: Scene
    words: NDArray[np.uint64]
    """Key of their random streams, from `key_words`."""
    objective: Objective
    experiments: tuple[ExperimentScene, ...] = ()
    """Their scenes in each experiment; none where the campaign has none."""

    def judge(self, task: np.void) -> Judge | None:
        """Return what ends a task that is judged, a record of `task_type`; None of others."""
        if not task["judged"]:
            return None
        rule, means = self.setup.campaign.ensemble, means_of(task)
        return judge_of(rule, self.objective, self.scene.particles, means, int(task["count"]))


class SimulatedStrings:
    """The last strings of an experiment that were asked for."""

    def __init__(self, experiment: Experiment) -> None:
        self._experiment = experiment
        self._kept: dict[tuple[int, bytes], SimulatedString] = {}

    def of(self, string: int, parameters: NDArray[np.float64]) -> SimulatedString:
        """Return a string by its number and its parameters, shape (k,)."""
        key = string, parameters.tobytes()
        found = self._kept.pop(key, None)
        if found is None:
            setup = self._experiment.setup(string)
            words = key_words(stream_key(setup.campaign, parameters))
            objective = setup.campaign.objective_at(parameters)
            scenes = experiment_scenes(setup.campaign, parameters, setup.engine)
            scene = scene_of(setup, parameters)
            found = SimulatedString(setup, scene, words, objective, scenes)
            if len(self._kept) == MAX_KEPT:
                del self._kept[next(iter(self._kept))]
        self._kept[key] = found
        return found


def scene_of(setup: SampleSetup, parameters: NDArray[np.float64]) -> Scene:
    """Return the scene of one parameter string, shape (k,), in a set-up."""
    return setup.campaign.at(parameters).build(setup.engine)
