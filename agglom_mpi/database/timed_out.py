"""Samples that were judged as failed but have no row: a resume may try them again."""

import numpy as np

from agglom_mpi.database.schema import TOOK_TOO_LONG


def judged_as_timed_out(
    failures: np.ndarray, results: np.ndarray, samples: np.ndarray
) -> list[tuple[int, int]]:
    """Find what results rest on that is in no row of `/samples`.

    Parameters
    ----------
    failures, results, samples : structured arrays
        Rows of these tables.

    Returns
    -------
    list of tuple
        (string, sample), in order.
    """
    late = late_failures(failures)
    if not late:
        return []
    used = dict(results[["string", "samples_used"]].tolist())
    pairs = {(int(row["string"]), int(row["sample"])) for row in late}
    pairs -= set(samples[["string", "sample"]].tolist())
    return sorted((string, sample) for string, sample in pairs if sample < used.get(string, 0))


def late_failures(failures: np.ndarray) -> list[np.void]:
    """Select rows of `/failures` that tell of samples that took too long."""
    return [row for row in failures if row["text"].startswith(TOOK_TOO_LONG.encode())]
