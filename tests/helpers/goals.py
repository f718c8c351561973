"""Objectives, by their numbers."""

from agglom_mpi.search.objectives.growth import GrowthTarget, MaximumGrowth
from agglom_mpi.search.objectives.moment_targets import MomentTargets
from agglom_mpi.search.objectives.own_function import MeanOfFunction

FUNCTION_MEAN = MeanOfFunction(call="worth:worth")
"""Mean of a function of a user."""


def growth_target(ratio=2.0):
    """Return the distance of the mean growth from a wanted one."""
    return GrowthTarget(ratio=ratio)


def maximum_growth(grains):
    """Return the distance from one aggregate of so many grains."""
    return MaximumGrowth().of_grains(grains)


def moment_targets(terms):
    """Return the objective of several `MomentTarget`s, also of targets that no radii can meet."""
    targets = {term.name: term.target for term in terms}
    weights = {term.name: term.weight for term in terms}
    return MomentTargets.recorded({"targets": targets, "weights": weights})
