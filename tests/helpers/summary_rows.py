"""Rows of `/samples` that sum up to given summaries."""

import numpy as np

from agglom_mpi.outcome import COMPLETED, FAILED
from agglom_mpi.storage.schema import sample_dtype


def rows_of(summaries):
    """Return the samples, (n,), of which `outcome.summaries` makes these again."""
    rows = np.zeros(len(summaries), sample_dtype)
    for row, summary in zip(rows, summaries, strict=True):
        row["state"] = COMPLETED if summary.completed else FAILED
        for name in ("mean_radius_ratio", "particles", "steps", "particle_steps", "objective"):
            row[name] = getattr(summary, name)
        for order, moment in zip((2, 3, 4), summary.central_moments, strict=True):
            row[f"radius_moment_{order}"] = moment
    return rows
