"""The digest of a generation: everything deterministic that it rests on, in eight bytes."""

import hashlib
from typing import Final

import numpy as np

from agglom_mpi.storage.columns import fitted
from agglom_mpi.storage.schema import FORMAT_VERSION, RESULTS, SAMPLES

NOT_DETERMINED: Final = ("seconds", "finished", "rank", "crc")
"""Columns that may differ between two runs of the same campaign."""


def generation_digest(
    parameters: np.ndarray,
    results: np.ndarray,
    samples: np.ndarray,
    version: int = FORMAT_VERSION,
) -> int:
    """BLAKE2b in 64 bits of what a generation rests on, as `/generations` explains it.

    Parameters
    ----------
    parameters : (n, 10) float64
        The strings judged in the generation, by number.
    results, samples : structured arrays
        Their rows of `/results` and, by string and sample, those of `/samples` that are used.
    version : int
        Format version of the file, whose columns count.
    """
    digest = hashlib.blake2b(digest_size=8)
    digest.update(parameters.astype("<f8").tobytes())
    digest.update(_packed(fitted(results, RESULTS.at(version).dtype)))
    digest.update(_packed(fitted(samples, SAMPLES.at(version).dtype)))
    return int.from_bytes(digest.digest(), "little")


def used_samples(samples: np.ndarray, results: np.ndarray) -> np.ndarray:
    """Select the rows that the results were judged by: each once, by string and sample."""
    if not len(samples) or not len(results):
        return samples[:0]
    most = np.zeros(1 + max(samples["string"].max(), results["string"].max()), np.int64)
    most[results["string"]] = results["samples_used"]
    used = samples[samples["sample"] < most[samples["string"]]]
    places = used["string"] * (1 + most.max()) + used["sample"]
    return used[np.unique(places, return_index=True)[1]]


def _packed(rows: np.ndarray) -> bytes:
    """Little-endian bytes of the deterministic columns, row after row."""
    names = [name for name in rows.dtype.names or () if name not in NOT_DETERMINED]
    dtype = np.dtype([(name, rows.dtype[name].newbyteorder("<")) for name in names])
    packed = np.empty(len(rows), dtype)
    for name in names:
        packed[name] = rows[name]
    return packed.tobytes()
