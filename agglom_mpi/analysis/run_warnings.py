"""Warnings on a finished run, and on the samples of a string, one line each."""

from collections.abc import Iterator
from math import inf
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.analysis.derived import searched_variables, values_of
from agglom_mpi.analysis.estimates import is_free_of_noise, objective_of, rounding_of
from agglom_mpi.analysis.finite_size import finite_size_warnings
from agglom_mpi.analysis.quantity_means import drawn_fraction
from agglom_mpi.analysis.ranking import RankedStrings, rank_strings
from agglom_mpi.formatting import in_unit, pluralise, value_with_error
from agglom_mpi.outcome import COMPLETED, FailureReason
from agglom_mpi.physics.restitution import Solver

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

FEWEST_LEFT: Final = 10
"""Mean number of particles left below which a box is too small for statistics of its particles.

The box is then about two of their spacings wide (10^(1/3) = 2.2): the neighbours of a particle are
the images of a few others, and an impact changes the mean of b/b0 by a tenth of itself and more.
"""
EARLY: Final = 0.1
"""Fraction of the end time; changes before it are early."""
EARLY_SAMPLES: Final = 3
"""Minimum number of samples for a warning that all changes are early."""


def few_left(left: float, grains: int, of: str = "") -> list[str]:
    """Return a line if fewer than `FEWEST_LEFT` particles are left of a scene that had more.

    Parameters
    ----------
    left
        Mean number of particles left.
    grains
        Number of grains at the start.
    of
        Which string, as ` in the best string`.
    """
    if left >= FEWEST_LEFT or grains < FEWEST_LEFT:
        return []
    return [
        f"scene.particles: {left:.3g} of {grains:,} particles are left on average{of}; fewer than "
        f"{FEWEST_LEFT} make the box too small for statistics, so start with more grains, or end "
        "earlier"
    ]


def early_changes(changes: int, samples: int) -> list[str]:
    """Return the warning that all `changes`, merges and breakups, of samples are early."""
    return [
        f"scene.end_time: all {changes:,} merges and breakups of {pluralise(samples, 'sample')} "
        f"happen in the first {EARLY:g} of it; an earlier end gives the same particles"
    ]


EDGE: Final = 0.01
"""Share of a range, or of its logarithm, from its end within which a value is at the edge."""
MISS: Final = 0.05
"""Objective of a wanted growth, a relative miss, above which the target is not reached."""


def run_warnings(file: "CampaignData") -> list[str]:
    """Return lines on a finished campaign; none of one that is still to go on.

    They say that the target was not reached, that the best string lies at the edge of the search
    box, has few particles left or samples that jammed, that the finite size of the box shifts the
    answer, in how many strings nothing happened, and that impact equations were not solved.
    """
    ranked = rank_strings(file)
    if file.status().state != "finished" or not ranked.order:
        return []
    best = ranked.order[0]
    return [
        *_target(file, ranked),
        *_edges(file, best),
        *_few(file, best),
        *finite_size_warnings(file, ranked.order),
        *_jammed(file, best),
        *_idle(file, ranked),
        *_unsolved(file),
    ]


def _target(file: "CampaignData", ranked: RankedStrings) -> Iterator[str]:
    """Yield the stopping target that was not reached; without one, an objective far from 0."""
    identity, generations = file.identity, file.generation_rows()
    wanted = identity.get("stopping.target.objective")
    if isinstance(wanted, int | float):
        reached = float(generations["mean_of_top"][-1]) if len(generations) else np.inf
        if reached > wanted + rounding_of(file):
            yield (
                f"stopping.target: the mean objective of the best "
                f"{identity['stopping.target.top']} is {reached:.3g}; wanted was at most "
                f"{wanted:g}, so more generations or a wider box may help"
            )
        return
    best = ranked.order[0]
    estimate = next((each for each in ranked.estimates if each.string == best), None)
    row = ranked.results[best]
    least = estimate.lower if estimate else row["objective"] - 2.0 * row["standard_error"]
    if objective_of(file).has_target and least > MISS:
        value = estimate.objective if estimate else float(row["objective"])
        yield (
            f"objective: the best string misses its target by {value:.3g}; for a target within "
            f"reach it is usually below {MISS:g}"
        )


def _edges(file: "CampaignData", best: int) -> Iterator[str]:
    """Yield each variable of the best string that lies at an end of its range."""
    for variable in searched_variables(file):
        value = float(values_of(file, [best], variable.name)[0])
        low, high, at = ends = variable.lower, variable.upper, value
        if variable.logarithmic:
            low, high, at = np.log(ends)
        share = (at - low) / (high - low)
        text = in_unit(f"{value:.4g}", variable.unit)
        for end, near in (("lower", share < EDGE), ("upper", share > 1.0 - EDGE)):
            if near:
                yield (
                    f"variables.{variable.name}: is {text} in the best string, at the "
                    f"{end} end of its range, {variable.lower:g} to {variable.upper:g}; "
                    "better ones may lie beyond"
                )


def _few(file: "CampaignData", best: int) -> list[str]:
    """Return a line if few particles are left in the samples of the best string."""
    rows = file.counted_samples
    rows = rows[(rows["string"] == best) & (rows["state"] == COMPLETED)]
    if not len(rows):
        return []
    left = float(rows["particles"].mean())
    return few_left(left, int(file.identity["scene.particles"]), " in the best string")


def _jammed(file: "CampaignData", best: int) -> Iterator[str]:
    """Yield how many samples found no place for grains that differ in size, and what that does."""
    rows = file.counted_samples
    jammed = int((rows["reason"] == FailureReason.PLACEMENT_JAMMED).sum())
    drawn = drawn_fraction(file, best) if jammed else None
    if drawn is not None:
        filled = value_with_error(drawn.completed.value, drawn.completed.error)
        yield (
            f"scene.sizes: {jammed:,} of {len(rows):,} samples found no place for the grains they "
            f"drew, mostly large ones; the completed samples of the best string fill {filled} of "
            f"the box, not {drawn.wanted:.3g}"
        )


def _idle(file: "CampaignData", ranked: RankedStrings) -> Iterator[str]:
    """Yield in how many strings no grain met another, and whether none ever bonded."""
    rows = file.counted_samples
    rows = rows[(rows["sample"] < file.fresh_from) & (rows["state"] == COMPLETED)]
    strings = np.unique(rows["string"])
    if not len(strings) or is_free_of_noise(file):
        return
    impacts = np.bincount(rows["string"], rows["collisions"])[strings]
    still, judged = int((impacts == 0).sum()), pluralise(len(strings), "string")
    if still:
        yield (
            f"scene.end_time: in {still} of {judged} no grain met another in any "
            "sample; usual are several collisions per grain"
        )
    if still < len(strings) and not rows["merges"].any():
        yield (
            f"variables: in none of {judged} did any grains bond, so b/b0 stayed 1; "
            "faster, denser or softer grains bond"
        )


def _unsolved(file: "CampaignData") -> Iterator[str]:
    """Yield how far impacts were left from e = G(e), where the solver promises a root."""
    name = file.identity.get("scene.solver.law")
    most = Solver.components()[name].largest_residual if name in Solver.components() else inf
    rows = file.counted_samples
    residuals = rows["largest_residual"][rows["state"] == COMPLETED]
    unsolved = int((residuals > most).sum())
    if unsolved:
        yield (
            f"scene.solver: in {unsolved:,} of {pluralise(len(residuals), 'completed sample')} an "
            f"impact was left with |e - G(e)| up to {residuals.max():.3g}; usual is below "
            f"{most:g}, so the restitution that the laws give may jump, or have no such root"
        )
