"""Sample rows made up for tests of what the report computes from them."""

import numpy as np
import pandas as pd

from agglom_mpi.outcome import COMPLETED, FAILED
from agglom_mpi.storage.schema import sample_dtype


def made_up(ratios, cost=1e-3, failed=(), **columns):
    """Rows of samples 0, 1, 2, … with given growth; those in `failed` did not complete.

    `cost` is their time in s, by the clock and on the processor.
    """
    rows = np.zeros(len(ratios), sample_dtype)
    rows["sample"] = np.arange(len(ratios))
    rows["state"] = COMPLETED
    rows["mean_radius_ratio"] = ratios
    rows["seconds"] = rows["cpu_seconds"] = cost
    rows["particles"] = 10
    for name, values in columns.items():
        rows[name] = values
    rows["state"][list(failed)] = FAILED
    return rows


def frame_of(table):
    """Return the rows of a table of a report, as its CSV file has them."""
    return pd.DataFrame(table.rows)
