"""SIGKILL in the middle of writing: nothing torn, nothing lost, and the next leg goes on."""

import fcntl
import os
import signal
from pathlib import Path
from typing import TextIO

import h5py
import numpy as np
import pytest
from storage_rows import make, put_result, put_strings, sample_rows

from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.schema import sample_dtype
from agglom_mpi.storage.writer import CampaignWriter

STRINGS, MAX_SAMPLES = 2000, 1000
PLAIN = [name for name in sample_dtype.names if name != "crc"]


def write_on(path: Path, string: int, seed: int, report: TextIO) -> None:
    """Write samples and results, and report each when it is written, for ever."""
    draw = np.random.default_rng(seed)
    with CampaignWriter(path) as writer:
        while True:
            at = 0
            while at < 990:
                count = int(draw.integers(1, 60))
                at += int(draw.integers(0, 3))
                rows = sample_rows(string, at, min(count, 1000 - at))
                writer.put_samples(rows)
                writer.flush()
                print("sample", string, at, len(rows), file=report, flush=True)
                at += count
            put_result(writer, string, 0.5)
            writer.flush()
            print("result", string, file=report, flush=True)
            string += 1


def run_and_kill(path: Path, string: int, seed: int, reports: int) -> list[list[str]]:
    """Write in a child that is killed after so many reports; what it reported as written."""
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, 4096)  # it runs ahead of its reader by some strings
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            write_on(path, string, seed, os.fdopen(writing, "w"))
        finally:
            os._exit(1)
    os.close(writing)
    with os.fdopen(reading) as pipe:
        try:
            first = "".join(pipe.readline() for _ in range(reports))
        finally:
            os.kill(child, signal.SIGKILL)
        rest = pipe.read()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    whole = (first + rest).rpartition("\n")[0]
    return [line.split() for line in whole.splitlines()]


@pytest.mark.parametrize("kills", [5, pytest.param(20, marks=pytest.mark.slow)])
def test_killed_writers_leave_whole_rows(tmp_path, kills):
    path = make(tmp_path / "killed.h5", strings=STRINGS, max_samples=MAX_SAMPLES)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, STRINGS)
    draw = np.random.default_rng(20240607)
    string, reports = 0, 0
    written = np.zeros((STRINGS, MAX_SAMPLES), bool)
    results = set()
    for kill in range(kills):
        report = run_and_kill(path, string, kill, int(draw.integers(1, 200)))
        reports += len(report)
        for kind, number, *run in report:
            if kind == "sample":
                first, count = map(int, run)
                written[int(number), first : first + count] = True
            else:
                results.add(int(number))
        string = int(report[-1][1]) + 2

        with h5py.File(path, "r+") as file:
            assert file["samples_done"][:].sum() >= written.sum()
        campaign = read_campaign(path)
        rows = campaign.all_sample_rows()
        present = np.zeros_like(written)
        present[rows["string"], rows["sample"]] = True
        assert campaign.damaged == 0
        assert not (written & ~present).any()
        assert results <= set(campaign.result_rows()["string"])

    expected = np.concatenate([sample_rows(n, 0, MAX_SAMPLES) for n in range(string)])
    places = rows["string"] * MAX_SAMPLES + rows["sample"]
    assert np.array_equal(rows[PLAIN], expected[places][PLAIN])
    assert reports > 10 * kills
