"""Public optimisers with one face: peers of the searches, set up for noise as they document it.

- Optuna: TPE, multivariate; CMA-ES with `lr_adapt`. The answer is `study.best_trial`.
- Nevergrad: TBPSA and NGOpt, with the function declared as not deterministic. The answer is
  `provide_recommendation()`.
- SMAC3: the random forest of `HyperparameterOptimizationFacade` with `deterministic=False`, which
  repeats good strings; it is trained after every 24 new ones. The answer is the incumbent.
- scikit-optimize: Gaussian process with Gaussian noise, expected improvement at sampled points. The
  answer is `expected_minimum`, the lowest mean of the process.

The libraries (optuna with cmaes, nevergrad, smac, scikit-optimize) are no dependency of this
package: install them into an environment of their own.
"""

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.answer_study import AnswerStudy
from agglom_mpi.outcome import OUTCOME
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.verbs.simulate_many import simulate_many

Floats = NDArray[np.float64]

SAMPLES: Final = 408
"""Samples of a run: those of the searches in the answer studies."""
BATCH: Final = 24
"""Strings of a batch of the surrogate."""
SEED_STEP: Final = 10**4
"""Samples between the first ones of two runs of a peer."""


class Peer(Protocol):
    """An optimiser of the unit cube that is asked for a point, told its value, and so on."""

    def ask(self) -> Floats: ...
    def tell(self, value: float) -> None: ...
    def best(self) -> Floats: ...


class OptunaPeer:
    def __init__(self, sampler: str, dimensions: int, seed: int, **options: Any) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        made = getattr(optuna.samplers, sampler)(seed=seed, **options)
        self._study = optuna.create_study(sampler=made)
        cube = optuna.distributions.FloatDistribution(0.0, 1.0)
        self._box = {f"x{i}": cube for i in range(dimensions)}

    def ask(self) -> Floats:
        self._trial = self._study.ask(self._box)
        return self._point(self._trial)

    def tell(self, value: float) -> None:
        self._study.tell(self._trial, value)

    def best(self) -> Floats:
        return self._point(self._study.best_trial)

    def _point(self, trial: Any) -> Floats:
        return np.array([trial.params[name] for name in self._box])


class NevergradPeer:
    def __init__(self, name: str, dimensions: int, seed: int) -> None:
        import nevergrad

        cube = nevergrad.p.Array(shape=(dimensions,), lower=0.0, upper=1.0)
        cube.function.deterministic = False
        cube.random_state.seed(seed)
        self._search = nevergrad.optimizers.registry[name](cube, budget=SAMPLES)

    def ask(self) -> Floats:
        self._point = self._search.ask()
        return np.array(self._point.value)

    def tell(self, value: float) -> None:
        self._search.tell(self._point, value)

    def best(self) -> Floats:
        return np.array(self._search.provide_recommendation().value)


class SmacPeer:
    def __init__(self, dimensions: int, seed: int) -> None:
        from ConfigSpace import ConfigurationSpace, Float
        from smac import HyperparameterOptimizationFacade as Facade
        from smac import Scenario

        space = ConfigurationSpace(seed=seed)
        space.add([Float(f"x{i}", (0.0, 1.0)) for i in range(dimensions)])
        self._folder = tempfile.TemporaryDirectory()
        plan = Scenario(
            space,
            deterministic=False,
            n_trials=SAMPLES,
            seed=seed,
            output_directory=Path(self._folder.name),
        )
        selector = Facade.get_config_selector(plan, retrain_after=BATCH)
        self._search = Facade(
            plan, lambda config, seed=0: 0.0, config_selector=selector, logging_level=False
        )

    def ask(self) -> Floats:
        self._trial = self._search.ask()
        return self._point(self._trial.config)

    def tell(self, value: float) -> None:
        from smac.runhistory.dataclasses import TrialValue

        self._search.tell(self._trial, TrialValue(cost=value))

    def best(self) -> Floats:
        return self._point(self._search.intensifier.get_incumbent())

    @staticmethod
    def _point(config: Any) -> Floats:
        return np.array([config[f"x{i}"] for i in range(len(config))])


class SkoptPeer:
    def __init__(self, dimensions: int, seed: int) -> None:
        from skopt import Optimizer

        box = [(0.0, 1.0)] * dimensions
        self._search = Optimizer(
            box, "GP", acq_func="EI", acq_optimizer="sampling", random_state=seed
        )

    def ask(self) -> Floats:
        self._asked = self._search.ask()
        return np.array(self._asked)

    def tell(self, value: float) -> None:
        self._search.tell(self._asked, value)

    def best(self) -> Floats:
        from skopt import expected_minimum

        return np.array(expected_minimum(self._search.get_result(), random_state=1)[0])

    def predicted(self, points: Floats) -> Floats:
        return np.array(self._search.models[-1].predict(self._search.space.transform(points)))


class Method(NamedTuple):
    """A peer: its library, what makes it of dimensions and a seed, and how it is run."""

    library: str
    peer: Callable[[int, int], Peer]
    per_string: int = 1
    most: int = SAMPLES


def optuna_tpe(dimensions: int, seed: int) -> Peer:
    return OptunaPeer("TPESampler", dimensions, seed, multivariate=True)


def optuna_cmaes(dimensions: int, seed: int) -> Peer:
    return OptunaPeer("CmaEsSampler", dimensions, seed, lr_adapt=True)


METHODS: Final = {
    "Optuna TPE": Method("optuna", optuna_tpe),
    "Optuna TPE, 5 a string": Method("optuna", optuna_tpe, 5),
    "Optuna CMA-ES": Method("optuna", optuna_cmaes),
    "Optuna CMA-ES, 5 a string": Method("optuna", optuna_cmaes, 5),
    "Nevergrad TBPSA": Method("nevergrad", partial(NevergradPeer, "TBPSA")),
    "Nevergrad NGOpt": Method("nevergrad", partial(NevergradPeer, "NGOpt")),
    "SMAC3": Method("smac", SmacPeer, most=144),
    "scikit-optimize": Method("skopt", SkoptPeer, most=48),
}


def objective_of(study: AnswerStudy, string: Floats, samples: int, first: int) -> float:
    """Return the objective of new samples of a string, (1, k), by the public interface."""
    found = simulate_many(study.question, string, samples, workers=1, first_sample=first)
    rows = np.zeros(samples, OUTCOME)
    for name in set(OUTCOME.names) & set(found.columns):
        rows[name] = found.columns[name][0]
    return float(study.question.objective.of_rows(rows)[0])


def reported(method: Method, study: AnswerStudy, seed: int) -> Iterator[tuple[int, Floats]]:
    """Yield samples used so far and the string, (k,), that a peer would report then."""
    space, used, last = SearchSpace.of(study.question.variables), 0, 0
    peer = method.peer(space.dimensions, seed)
    while used < method.most:
        string = space.from_unit(peer.ask()[None])
        peer.tell(objective_of(study, string, method.per_string, seed * SEED_STEP + used))
        used += method.per_string
        if used >= last + BATCH or used >= method.most:
            last = used
            yield used, space.from_unit(peer.best()[None])[0]
