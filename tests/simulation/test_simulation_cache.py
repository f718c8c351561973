"""What one process has compiled, the next one loads from the disk."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

QUICKSTART = Path(__file__).parents[2] / "jobs" / "quickstart.yaml"

SAMPLE = """
import json, sys
from agglom_mpi.campaign import Campaign
from agglom_mpi.simulation.sample import run
record = Campaign.from_text(sys.stdin.read()).simulate({"size_ratio": 0.6}, 1).record
hits, misses = (sum(count.values()) for count in (run.stats.cache_hits, run.stats.cache_misses))
print(json.dumps([hits, misses, record.tobytes().hex()]))
"""


def plain_text():
    """The quickstart with the event engine and few laws, which compile sooner."""
    text = QUICKSTART.read_text()
    text = re.sub(r"\n  (duration|hardness|friction|reaction): .*", "", text)
    return re.sub(
        r"end_time: .*",
        "restitution: {law: constant, value: 0.5}\n  heating: none\n  end_time: 1 ms",
        text,
    )


def sample_in_a_new_process(text, folder):
    done = subprocess.run(
        [sys.executable, "-c", SAMPLE],
        input=text,
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder)},
        timeout=300,
    )
    return json.loads(done.stdout)


def files_in(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


@pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="nothing is compiled then"
)
def test_a_second_process_compiles_nothing_and_computes_the_same_bits(tmp_path):
    text = plain_text()
    hits, misses, first = sample_in_a_new_process(text, tmp_path)
    assert (hits, misses) == (0, 1)
    stored = files_in(tmp_path)
    assert any(path.suffix == ".nbc" for path in stored)
    hits, misses, second = sample_in_a_new_process(text, tmp_path)
    assert (hits, misses) == (1, 0)
    assert files_in(tmp_path) == stored
    assert second == first
