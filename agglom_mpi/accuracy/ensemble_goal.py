"""Which tolerance of each stopping rule gives a wanted error, and at what cost?"""

import math
from typing import TYPE_CHECKING

import numpy as np

from agglom_mpi.accuracy.stopping_study import OWN, Truth

if TYPE_CHECKING:
    import pandas as pd


def round_goal(truth: Truth) -> float:
    """Return 1 %, or the next power of ten that takes at least two samples."""
    goal = 1e-2
    while (truth.spread / truth.mean / goal) ** 2 < 2.0:
        goal *= 0.1
    return goal


def of_rules(frame: "pd.DataFrame") -> "pd.DataFrame":
    """Leave out the campaign's own rule, and tolerances at which most ensembles never stopped."""
    return frame[(frame["rule"] != OWN) & (frame["ended at max_samples"] <= 0.5)]


def at_goal(frame: "pd.DataFrame", goal: float) -> "pd.DataFrame":
    """Pick each rule's loosest tolerance that reaches a relative error, or its tightest."""
    picked = []
    for _, rows in frame.groupby("rule", sort=False):
        reached = np.flatnonzero(rows["rms error"] <= goal)
        picked.append(rows.index[reached[0] if len(reached) else -1])
    return frame.loc[picked]


def samples_needed(rows: "pd.DataFrame", goal: float) -> float:
    """Mean samples at which a rule reaches a relative error, between its tolerances; nan: never."""
    error, spent = rows["rms error"].to_numpy(), rows["samples, mean"].to_numpy()
    reached = np.flatnonzero(error <= goal)
    if not len(reached):
        return math.nan
    k = int(reached[0])
    if k == 0:
        return float(spent[0])
    way = math.log(error[k - 1] / goal) / math.log(error[k - 1] / error[k])
    return float(spent[k - 1] * (spent[k] / spent[k - 1]) ** way)


def covers_too_little(rows: "pd.DataFrame") -> "pd.Series[bool]":
    """Tell of each row whether its 95 % intervals contain the truth too rarely for chance."""
    return rows["coverage"] < 0.95 - 4.0 * rows["coverage, standard error"]
