"""Samples that have no row because they took too long: known from what is stored of failures."""

import numpy as np

from agglom_mpi.storage.schema import TOOK_TOO_LONG


def timed_out(failures: np.ndarray, samples: np.ndarray) -> set[tuple[int, int]]:
    """Return (string, sample) that have no row because they took too long."""
    late = np.array([text.startswith(TOOK_TOO_LONG.encode()) for text in failures["text"]], bool)
    if not late.any():
        return set()
    pairs = set(failures[["string", "sample"]][late].tolist())
    return pairs - set(samples[["string", "sample"]].tolist())


def judged_as_timed_out(
    failures: np.ndarray, samples: np.ndarray, results: np.ndarray
) -> list[tuple[int, int]]:
    """Return those samples without a row, because they took too long, that results rest on."""
    late = timed_out(failures, samples)
    used = dict(results[["string", "samples_used"]].tolist()) if late else {}
    return sorted((string, sample) for string, sample in late if sample < used.get(string, 0))
