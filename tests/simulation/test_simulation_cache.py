"""What one process has compiled, the next one loads from the disk."""

import json
import os
import re
import sys
from pathlib import Path

import pytest
from processes import output_of, program

ROOT = Path(__file__).parents[2]

COUNT = """
hits, misses = (sum(count.values()) for count in (used.stats.cache_hits, used.stats.cache_misses))
print(json.dumps([hits, misses, result]))
"""
IMPACT = """
import json, sys
sys.path.insert(0, sys.argv[1])
from contact_pairs import constant_laws, contact_pair
from agglom_mpi.simulation.impact import solve_impact as used
impact = used(constant_laws(0.5, None, None), contact_pair(3.0))
result = [float(number).hex() for number in impact]
"""
SAMPLE = """
import json, sys
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.verbs.simulate import simulate
from agglom_mpi.simulation.sample import measure_sample as used
record = simulate(Campaign.from_text(sys.argv[1]), {"size_ratio": 0.6}, 1).record
result = record.tobytes().hex()
"""


def few_laws():
    """The quickstart with the event engine and few laws, which compile sooner."""
    text = (ROOT / "jobs" / "quickstart.yaml").read_text()
    text = re.sub(r"\n  (duration|hardness|friction|reaction): .*", "", text)
    return re.sub(
        r"end_time: .*",
        "restitution: {law: constant, value: 0.5}\n  heating: none\n  end_time: 1 ms",
        text,
    )


def in_a_new_process(code, argument, folder):
    variables = os.environ | {"NUMBA_CACHE_DIR": str(folder)}
    with program([sys.executable, "-c", code + COUNT, argument], env=variables) as process:
        said, complaint = output_of(process)
    assert process.returncode == 0, complaint
    return json.loads(said)


def files_in(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


@pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="nothing is compiled then"
)
@pytest.mark.parametrize(
    ("code", "argument"),
    [
        pytest.param(IMPACT, str(ROOT / "tests" / "helpers"), id="impact"),
        pytest.param(SAMPLE, few_laws(), id="sample", marks=pytest.mark.slow),
    ],
)
def test_a_second_process_compiles_nothing_and_computes_the_same_bits(code, argument, tmp_path):
    hits, misses, first = in_a_new_process(code, argument, tmp_path)
    assert (hits, misses) == (0, 1)
    stored = files_in(tmp_path)
    assert any(path.suffix == ".nbc" for path in stored)
    hits, misses, second = in_a_new_process(code, argument, tmp_path)
    assert (hits, misses) == (1, 0)
    assert files_in(tmp_path) == stored
    assert second == first
