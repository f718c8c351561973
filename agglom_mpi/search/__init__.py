"""Parameter space, search methods, objectives and ensembles; no MPI, no files."""

from agglom_mpi.search.ensembles import Ensemble, EnsembleResult
from agglom_mpi.search.genetic import GeneticSearch
from agglom_mpi.search.inversion import GenerationSummary, Inversion, Observer, Progress, Target
from agglom_mpi.search.objectives import GrowthTarget, MaximumGrowth, Objective, make_objective
from agglom_mpi.search.proposals import OFFSPRING, ORIGINS, RANDOM, Batch, Search
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.search.stopping import (
    Moments,
    Rule,
    StandardError,
    SuccessiveDifference,
    make_rule,
)

__all__ = [
    "OFFSPRING",
    "ORIGINS",
    "RANDOM",
    "Batch",
    "Ensemble",
    "EnsembleResult",
    "GenerationSummary",
    "GeneticSearch",
    "GrowthTarget",
    "Inversion",
    "MaximumGrowth",
    "Moments",
    "Objective",
    "Observer",
    "Progress",
    "Rule",
    "Search",
    "SearchSpace",
    "StandardError",
    "SuccessiveDifference",
    "Target",
    "make_objective",
    "make_rule",
]
