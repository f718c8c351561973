"""What the generation in hand rests on, kept by rank 0 until its digest is stored with it."""

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.search.ensemble import EnsembleResult
from agglom_mpi.storage.schema import FORMAT_VERSION, RESULTS, sample_dtype
from agglom_mpi.storage.table import concatenated, generation_digest, used_samples
from agglom_mpi.variables import COUNT


class DigestAccumulator:
    """Strings, results and samples as they come, and their digest at the end of a generation.

    They are those that the decisions were made from, not what a file gives back.

    Parameters
    ----------
    samples
        Rows of earlier legs.
    version
        Format version of the file.
    """

    def __init__(self, samples: NDArray[np.void], version: int = FORMAT_VERSION) -> None:
        self._version = version
        self._parameters = np.empty((0, COUNT))
        self._results: dict[int, NDArray[np.void]] = {}
        self._samples = [samples]

    def proposed(self, parameters: NDArray[np.float64]) -> None:
        """Take the strings of the next generation, shape (n, 10)."""
        self._parameters = parameters
        self._results.clear()

    def simulated(self, rows: NDArray[np.void]) -> None:
        """Take samples of any strings."""
        self._samples.append(rows)

    def judged(self, string: int, row: NDArray[np.void]) -> None:
        """Take the result of a string, a row of `/results` of shape (1,)."""
        self._results[string] = row

    def digest(self) -> int:
        """Digest of the generation; its samples, and earlier ones, are forgotten."""
        strings = sorted(self._results)
        results = concatenated([self._results[string] for string in strings], RESULTS.dtype)
        samples = concatenated(self._samples, sample_dtype)
        self._samples = [samples[samples["string"] > strings[-1]]]
        used = used_samples(samples, results)
        return generation_digest(self._parameters, results, used, self._version)


def result_row(string: int, result: EnsembleResult) -> NDArray[np.void]:
    """Row of `/results`, shape (1,), without its checksum."""
    row = np.zeros(1, RESULTS.dtype)
    row["string"] = string
    for name, value in result._asdict().items():
        row[name] = value
    return row
