"""What a finished run should be looked at for again, one line each."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.analysis.derived import values_of
from agglom_mpi.analysis.ranking import RankedStrings, rank_strings
from agglom_mpi.analysis.tables import searched_variables
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import COMPLETED

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

EDGE: Final = 0.01
"""Share of a range, or of its logarithm, from its end within which a value is at the edge."""
MISS: Final = 0.05
"""Objective of a wanted growth, a relative miss, above which the target is not reached."""
AIMED: Final = ("growth_target", "moments")
"""Objectives that are 0 where their targets are met."""


def run_warnings(file: "CampaignData") -> list[str]:
    """Return lines on a finished campaign; none of one that is still to go on.

    They say that the target was not reached, that the best string lies at the edge of the search
    box, and in how many strings nothing happened.
    """
    ranked = rank_strings(file)
    if file.status().state != "finished" or not ranked.order:
        return []
    return [*_target(file, ranked), *_edges(file, ranked.order[0]), *_idle(file, ranked)]


def _target(file: "CampaignData", ranked: RankedStrings) -> Iterator[str]:
    """Yield the stopping target that was not reached; without one, an objective far from 0."""
    identity, generations = file.identity, file.generation_rows()
    wanted = identity.get("stopping.target.objective")
    if isinstance(wanted, int | float):
        reached = float(generations["mean_of_top"][-1]) if len(generations) else np.inf
        if reached > wanted:
            yield (
                f"stopping.target: the mean objective of the best "
                f"{identity['stopping.target.top']} is {reached:.3g}; wanted was at most "
                f"{wanted:g}, so more generations or a wider box may help"
            )
        return
    best = ranked.order[0]
    estimate = next((e for e in ranked.estimates if e.string == best), None)
    row = ranked.results[best]
    least = estimate.lower if estimate else row["objective"] - 2.0 * row["standard_error"]
    if identity.get("objective.law") in AIMED and least > MISS:
        value = estimate.objective if estimate else float(row["objective"])
        yield (
            f"objective: the best string misses what is wanted by {value:.3g}; usual for a target "
            f"within reach is below {MISS:g}"
        )


def _edges(file: "CampaignData", best: int) -> Iterator[str]:
    """Yield each variable of the best string that lies at an end of its range."""
    for variable, lower, upper, logarithmic in searched_variables(file):
        value = float(values_of(file, [best], variable.name)[0])
        low, high, at = np.log([lower, upper, value]) if logarithmic else (lower, upper, value)
        share = (at - low) / (high - low)
        unit = "" if variable.unit == "1" else f" {variable.unit}"
        for end, near in (("lower", share < EDGE), ("upper", share > 1.0 - EDGE)):
            if near:
                yield (
                    f"variables.{variable.name}: is {value:.4g}{unit} in the best string, at the "
                    f"{end} end of its range, {lower:g} to {upper:g}; better ones may lie beyond"
                )


def _idle(file: "CampaignData", ranked: RankedStrings) -> Iterator[str]:
    """Yield in how many strings no grain met another, and whether none ever bonded."""
    rows = file.searched_samples
    rows = rows[rows["state"] == COMPLETED]
    strings = np.unique(rows["string"])
    if not len(strings):
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
