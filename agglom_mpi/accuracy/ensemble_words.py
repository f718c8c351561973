"""What the study of the stopping rules says, in words computed from its numbers."""

import math
from typing import TYPE_CHECKING, Any, Final

from agglom_mpi.accuracy.ensemble_goal import (
    at_goal,
    covers_too_little,
    of_rules,
    samples_needed,
)
from agglom_mpi.accuracy.stopping_study import FIRST_MOMENT, OWN, WITH_ERROR, Truth
from agglom_mpi.formatting import format_digits, format_percent

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.config.ensemble import AnyEnsemble

TITLE: Final = "Ensemble: how many samples, and when to stop"

PROBLEM: Final = (
    "A string is judged by the mean of b/b⁰ over samples that differ by their random starts. The "
    "published rules stop when one sample more changes the running mean by less than a share TOL "
    "of it [A 27] [B 8.1], or when it changes none of the moments 1 to r of the radii by more "
    "[A 25]; order 1 is the rule [A 27] itself. The standard-error rule stops when half the 95 % t "
    "interval of the objective is at most TOL, an absolute number. How far off is the mean that "
    "each rule ends with, how many samples did it take, and does the rule know?"
)

ERROR_CAPTION: Final = (
    "True error of the ensemble mean against the samples spent, one point per tolerance, with 95 % "
    "bands; the dashed line is a number of samples fixed beforehand, spread/√n. Tolerances at "
    "which most ensembles ended at max_samples are left out."
)
BELIEF_CAPTION: Final = (
    "True error against the error that the tolerance is, taken at its word: TOL of the mean, TOL "
    "of the objective, or half the 95 % interval, which is about twice the rms error. On the grey "
    "line error and tolerance are the same."
)
COVERAGE_CAPTION: Final = (
    "Share of the reported 95 % intervals, mean ± t·SE at the stop, that contain the truth, with "
    "its binomial 95 % band."
)

OTHER_OBJECTIVE: Final = (
    "the campaign's objective looks at more than mean radii, so here it is the greatest growth, "
    "and its own rule is left out"
)


def share(row: Any, name: str) -> str:
    """Share and its standard error in percent, from the columns of a row."""
    if math.isnan(row[name]):
        return "–"
    return f"{100.0 * row[name]:.1f} ± {100.0 * row[f'{name}, standard error']:.1f} %"


def reference(samples: int, truth: Truth) -> str:
    """Say what errors are measured against."""
    spread = format_percent(truth.spread / truth.mean)
    return (
        f"Orders are drawn with replacement from a pool of {samples} completed samples of one "
        f"string: a bootstrap, for which the pool's own mean of b/b⁰, {truth.mean:.6g}, is the "
        f"exact truth and spread/√n with the pool's own spread, {spread} of the mean, the exact "
        "rms error of n samples. How well the pool stands for the string is no part of it."
    )


def setups(
    orders: int, most: int, failed: int, model: "AnyEnsemble | None", other: bool = False
) -> str:
    """Say what was run."""
    own = OTHER_OBJECTIVE if other else "the scene has no rule of its own"
    if model is not None:
        limits = f"{model.min_samples} to {min(most, model.max_samples)}"
        own = f"the campaign's own rule is kept within its own limits, {limits}"
    text = (
        f"{orders} random orders of {most} samples, the same for every rule and tolerance; the "
        f"published rules are asked from 2 samples on, the standard-error rule from 5; {own}. A "
        "stop is by luck if the mean is further from the truth than the tolerance taken as an "
        "error bound: |mean − truth| > TOL·|truth| for the published rules, of the quantity that "
        "they watch (of the moments: the first alone); |mean − truth| > TOL for the objective of "
        "the standard-error rule, for which 5 % is right. Of stops by luck the share is of the "
        "ensembles that the rule stopped; coverage is of all."
    )
    if failed:
        text += f" {failed} samples of the pool had failed and were left out."
    return text


def table_caption(goal: float) -> str:
    """Say what a row of the document's table is."""
    return (
        f"Each rule at its loosest tolerance whose mean is right to {format_percent(goal)} "
        f"(rms), or at "
        "the tightest if none is; and the campaign's own, if it has one."
    )


def conclusions(frame: "pd.DataFrame", truth: Truth, goal: float) -> tuple[str, ...]:
    """Say what the numbers say."""
    return (
        _cost(frame, truth, goal),
        *_published(frame),
        _scatter(of_rules(frame), goal),
        *_with_error(of_rules(frame), goal),
        *(_own(row) for _, row in frame[frame["rule"] == OWN].iterrows()),
    )


def _cost(frame: "pd.DataFrame", truth: Truth, goal: float) -> str:
    best = (truth.spread / truth.mean / goal) ** 2
    costs = []
    for rule, rows in of_rules(frame).groupby("rule", sort=False):
        needed = samples_needed(rows, goal)
        if math.isnan(needed):
            costs.append(
                f"not reached by {rule} ({format_percent(rows['rms error'].min())} at best)"
            )
        else:
            costs.append(f"{needed:.0f} by {rule}")
    return (
        f"A mean that is right to {format_percent(goal)} (rms) takes {best:.0f} samples if their "
        f"number "
        f"is fixed beforehand, and on average {'; '.join(costs)}."
    )


def _published(frame: "pd.DataFrame") -> list[str]:
    told = []
    for tolerance in (1e-3, 1e-5):
        rows = frame[(frame["rule"] == FIRST_MOMENT) & (frame["tolerance"] == tolerance)]
        for _, row in rows.iterrows():
            told.append(
                f"Successive differences of the mean radius at TOL = {tolerance:g} believe "
                f"{tolerance:g} and are off by {format_percent(row['rms error'])} (rms), "
                f"{format_digits(row['rms error'] / tolerance)} times as much; "
                f"{share(row, 'stopped by luck')} of their stops were by luck."
            )
    return told


def _scatter(frame: "pd.DataFrame", goal: float) -> str:
    row = at_goal(frame[frame["rule"] == FIRST_MOMENT], goal).iloc[0]
    excess = (row["rms error"] / row["rms error, fixed number"]) ** 2
    return (
        f"When they stop is chance: at TOL = {row['tolerance']:g} one ensemble in ten ends before "
        f"{row['samples, 10 %']:.0f} samples and one in ten after {row['samples, 90 %']:.0f}, so "
        f"that {row['samples, mean']:.0f} samples on average are worth "
        f"{row['samples, mean'] / excess:.0f} of a number fixed beforehand."
    )


def _with_error(frame: "pd.DataFrame", goal: float) -> list[str]:
    rows = frame[frame["rule"] == WITH_ERROR]
    if rows.empty:
        return []
    row = at_goal(rows, goal).iloc[0]
    told = (
        f"Of the standard-error rule's means at TOL = {row['tolerance']:g}, "
        f"{format_percent(row['error believed'])} of the mean, {share(row, 'stopped by luck')} are "
        "further off than that, where 5 % should be"
    )
    short = rows[covers_too_little(rows)]
    if short.empty:
        return [f"{told}."]
    worst = short.sort_values("coverage").iloc[0]
    return [
        f"{told}; but tolerances that {short['samples, mean'].min():.0f} to "
        f"{short['samples, mean'].max():.0f} samples satisfy are met too early by chance, and the "
        f"intervals then cover {format_percent(worst['coverage'])} at worst."
    ]


def _own(row: Any) -> str:
    return (
        f"This campaign's own rule (TOL = {row['tolerance']:g}) spends {row['samples, mean']:.0f} "
        f"samples and is off by {format_percent(row['rms error'])} (rms); its 95 % interval "
        f"contains the "
        f"truth in {share(row, 'coverage')} of the ensembles, and "
        f"{format_percent(row['ended at max_samples'])} ended at max_samples."
    )


def failures(frame: "pd.DataFrame") -> tuple[str, ...]:
    """Say which intervals cover too little, which rules stop by luck, and which never stop."""
    told = []
    for rule, rows in frame.groupby("rule", sort=False):
        known = rows[rows["stopped by luck"].notna()]
        bound = 0.05 + 4.0 * known["stopped by luck, standard error"]
        lucky = known[known["stopped by luck"] > bound]
        if len(lucky):
            low, high = lucky["stopped by luck"].min(), lucky["stopped by luck"].max()
            between = (
                format_percent(low)
                if low == high
                else f"{format_percent(low)} to {format_percent(high)}"
            )
            told.append(f"{_name(rule)}: {between} of the stops were by luck, {_where(lucky)}.")
        short = rows[covers_too_little(rows)]
        if len(short):
            worst = short.sort_values("coverage").iloc[0]
            told.append(
                f"{_name(rule)}: the 95 % interval contains the truth too rarely {_where(short)}, "
                f"in {share(worst, 'coverage')} of the ensembles at TOL = {worst['tolerance']:g}."
            )
        endless = rows[rows["ended at max_samples"] > 0.5]
        if len(endless):
            told.append(f"{_name(rule)}: most ensembles ended at max_samples {_where(endless)}.")
    return tuple(told)


def _name(rule: Any) -> str:
    return f"{str(rule)[0].upper()}{str(rule)[1:]}"


def _where(rows: "pd.DataFrame") -> str:
    tolerances = rows["tolerance"]
    if len(rows) == 1:
        return f"at TOL = {tolerances.iloc[0]:g}"
    return f"at TOL = {tolerances.iloc[0]:g} to {tolerances.iloc[-1]:g}"
