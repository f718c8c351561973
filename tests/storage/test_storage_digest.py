"""What a digest depends on, and that it is what the schema says."""

import hashlib
import struct

import numpy as np
import pytest
from storage_rows import sample_rows

from agglom_mpi.runtime.recorder import DigestAccumulator
from agglom_mpi.storage.schema import RESULTS, SAMPLES
from agglom_mpi.storage.table import consecutive_samples, generation_digest, used_samples


@pytest.fixture
def rested():
    """Parameters, results and samples, used and not, of strings 3 and 4."""
    results = np.zeros(2, RESULTS.dtype)
    results["string"], results["samples_used"] = [3, 4], [2, 3]
    results["objective"], results["standard_error"] = [0.25, 0.5], np.nan
    parameters = np.random.default_rng(1).random((2, 10))
    return parameters, results, np.concatenate([sample_rows(3, 0, 4), sample_rows(4, 0, 3)])


def digest(parameters, results, samples):
    return generation_digest(parameters, results, used_samples(samples, results))


def test_a_digest_is_what_the_schema_says(rested):
    parameters, results, samples = rested
    text = struct.pack("<20d", *parameters.ravel())
    for row in results:
        *values, _ = row.tolist()
        text += struct.pack("<qdddddqqB", *values)
    codes = {"i8": "q", "f8": "d", "u1": "B"}
    free = ("seconds", "cpu_seconds", "finished", "rank", "crc")
    kept = [field for field in SAMPLES.fields if field.name not in free]
    for row in samples[[0, 1, 4, 5, 6]]:
        for field in kept:
            text += struct.pack(f"<{codes[field.dtype]}", row[field.name])
    expected = int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "little")
    assert digest(parameters, results, samples) == expected


def test_what_runs_may_differ_in_does_not_change_a_digest(rested):
    parameters, results, samples = rested
    other = np.random.default_rng(2).permutation(np.concatenate([samples, sample_rows(5, 0, 2)]))
    other["seconds"], other["cpu_seconds"], other["finished"] = 9.0, 7.5, 8.0
    other["rank"], other["crc"] = 7, 5
    other["objective"][(other["string"] == 3) & (other["sample"] == 3)] = -1.0  # not used
    assert digest(parameters, results, other) == digest(*rested)


@pytest.mark.parametrize("column", [field.name for field in SAMPLES.fields[2:-5]])
def test_every_other_column_of_a_used_sample_changes_it(rested, column):
    before = digest(*rested)
    rested[2][column][1] += 1
    assert digest(*rested) != before


@pytest.mark.parametrize("column", [field.name for field in RESULTS.fields[1:-1]])
def test_every_column_of_a_result_changes_it(rested, column):
    before = digest(*rested)
    rested[1][column][1] = 1
    assert digest(*rested) != before


def test_every_parameter_changes_it(rested):
    before = digest(*rested)
    found = set()
    for at in np.ndindex(2, 10):
        parameters = rested[0].copy()
        parameters[at] = np.nextafter(parameters[at], 2.0)
        found.add(digest(parameters, *rested[1:]))
    assert len(found | {before}) == 21


def test_accumulator_gathers_the_same_from_pieces_in_any_order(rested):
    parameters, results, samples = rested
    earlier, late = samples[[2, 5]], sample_rows(5, 0, 2)
    accumulator = DigestAccumulator(earlier)
    accumulator.begin(parameters)
    accumulator.add_samples(np.concatenate([late, samples[[6, 0]]]))
    accumulator.add_result(4, results[1:])
    accumulator.add_samples(samples[[1, 4, 3]])
    accumulator.add_result(3, results[:1])
    assert accumulator.digest() == digest(*rested)
    later = results[:1].copy()
    later["string"] = 5
    accumulator.begin(parameters[:1])
    accumulator.add_result(5, later)
    assert accumulator.digest() == digest(parameters[:1], later, late)


def test_samples_of_two_strings_are_never_consecutive():
    rows = sample_rows(0, 0, 4)
    rows["string"], rows["sample"] = [0, 0, 1, 1], [0, 1, 2, 4]
    parts = [part[["string", "sample"]].tolist() for part in consecutive_samples(rows)]
    assert parts == [[(0, 0), (0, 1)], [(1, 2)], [(1, 4)]]
