"""Stopping rules, and ensembles that end by them within given limits."""

from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.stopping import FixedNumber, Moments, StandardError, SuccessiveDifference

UNLIMITED_SAMPLES = 10**6
"""Maximum number of samples where a rule alone is to end them."""


def difference(tolerance, quantity="objective", **limits):
    """Return the rule of successive differences."""
    limits = {"max_samples": UNLIMITED_SAMPLES, **limits}
    return SuccessiveDifference(tolerance=tolerance, quantity=quantity, **limits)


def settled_moments(tolerance, order):
    """Return the rule that moments up to an order no longer change."""
    return Moments(tolerance=tolerance, order=order, max_samples=UNLIMITED_SAMPLES)


def half_width(tolerance, min_samples=5, max_samples=UNLIMITED_SAMPLES):
    """Return the rule that the 95 % interval is narrow enough."""
    return StandardError(tolerance=tolerance, min_samples=min_samples, max_samples=max_samples)


def fixed(samples):
    """Return the rule of a fixed number of samples."""
    return FixedNumber(samples=samples)


def ensemble_of(rule, objective, particles, least, most):
    """Return an ensemble of at least `least`, and at least the rule's own, to `most` samples."""
    limits = {"min_samples": max(least, rule.min_samples), "max_samples": most}
    return Ensemble(rule.model_copy(update=limits), objective, particles)
