"""Parameter space, search methods, objectives and ensembles; no MPI, no files."""

from agglom_mpi.search.ensembles import Ensemble, EnsembleResult
from agglom_mpi.search.inversion import GenerationSummary, Inversion, Observer, Progress, Target
from agglom_mpi.search.methods import make_search
from agglom_mpi.search.objectives import GrowthTarget, MaximumGrowth, make_objective
from agglom_mpi.search.proposals import OFFSPRING, ORIGINS, RANDOM, Batch, Judged, Ranked, Search
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.search.stopping import (
    Moments,
    Rule,
    StandardError,
    SuccessiveDifference,
    make_rule,
)
from agglom_mpi.search.worth import Objective

__all__ = [
    "OFFSPRING",
    "ORIGINS",
    "RANDOM",
    "Batch",
    "Ensemble",
    "EnsembleResult",
    "GenerationSummary",
    "GrowthTarget",
    "Inversion",
    "Judged",
    "MaximumGrowth",
    "Moments",
    "Objective",
    "Observer",
    "Progress",
    "Ranked",
    "Rule",
    "Search",
    "SearchSpace",
    "StandardError",
    "SuccessiveDifference",
    "Target",
    "make_objective",
    "make_rule",
    "make_search",
]
