"""SIGKILL in the middle of writing: nothing torn, nothing lost, and the next leg goes on."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
from database_helpers import make, put_strings, sample_rows

from agglom_mpi.database.reader import open_campaign
from agglom_mpi.database.schema import sample_dtype
from agglom_mpi.database.writer import CampaignWriter

KILLS = 20
STRINGS, MAX_SAMPLES = 2000, 1000
PLAIN = [name for name in sample_dtype.names if name != "crc"]

CHILD = """
import sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from database_helpers import put_result, sample_rows
from agglom_mpi.database.writer import CampaignWriter
path, string, seed = sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
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
            print("sample", string, at, len(rows), flush=True)
            at += count
        put_result(writer, string, 0.5)
        writer.flush()
        print("result", string, flush=True)
        string += 1
"""


def run_and_kill(path: Path, string: int, seed: int, delay: float) -> list[list[str]]:
    """Write until killed; what was reported as written."""
    arguments = [str(Path(__file__).parent), str(path), str(string), str(seed)]
    with subprocess.Popen(
        [sys.executable, "-c", CHILD, *arguments], stdout=subprocess.PIPE, text=True
    ) as child:
        first = child.stdout.readline()
        time.sleep(delay)
        child.send_signal(signal.SIGKILL)
        rest = child.stdout.read()
    assert child.returncode == -signal.SIGKILL
    whole = (first + rest).rpartition("\n")[0]
    return [line.split() for line in whole.splitlines()]


def test_killed_writers_leave_whole_rows(tmp_path):
    path = make(tmp_path / "killed.h5", strings=STRINGS, max_samples=MAX_SAMPLES)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, STRINGS)
    draw = np.random.default_rng(20240607)
    string, reports = 0, 0
    written = np.zeros((STRINGS, MAX_SAMPLES), bool)
    results = set()
    for kill in range(KILLS):
        report = run_and_kill(path, string, kill, draw.uniform(0, 0.1))
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
        campaign = open_campaign(path)
        rows = campaign.all_sample_rows()
        present = np.zeros_like(written)
        present[rows["string"], rows["sample"]] = True
        assert campaign.damaged == 0
        assert not (written & ~present).any()
        assert results <= set(campaign.result_rows()["string"])

    expected = np.concatenate([sample_rows(n, 0, MAX_SAMPLES) for n in range(string)])
    places = rows["string"] * MAX_SAMPLES + rows["sample"]
    assert np.array_equal(rows[PLAIN], expected[places][PLAIN])
    assert reports > 10 * KILLS
