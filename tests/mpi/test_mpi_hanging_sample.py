"""A user's function that does not return is named, with its rank, while the others go on."""

import re

import pytest
from campaign_runs import assert_sound, environment, inject, need_mpirun
from processes import HANG, program, wait_for
from user_function_runs import write_own

NAMED_SOON = """
import agglom_mpi.runtime.failures as hanging_samples
import agglom_mpi.runtime.silence as silence

hanging_samples.MIN_SECONDS, hanging_samples.FACTOR, silence.ALIVE_EVERY = 0.5, 1e-9, 0.1
"""

HANGS_ONCE = """
import os
import time
from pathlib import Path

judged = 0

def worth(sample):
    global judged
    judged += 1
    # Not a value of the module: those are the same on all ranks.
    rank = os.environ.get("PMI_RANK", os.environ.get("OMPI_COMM_WORLD_RANK", "0"))
    while rank == "LAST" and judged > 5 and not Path("opened").exists():
        time.sleep(0.01)
    return abs(sample.mean_radius_ratio - 2.0)
"""


@pytest.mark.ranks(guard="runtime/test_hanging_samples.py")
def test_a_function_that_does_not_return_is_named_again_and_again(tmp_path):
    need_mpirun()
    write_own(tmp_path, HANGS_ONCE.replace("LAST", "1"))
    words = ["mpirun", "-n", "2", "agglom-invert", "own.yaml", "--allow-code"]
    options = {"cwd": tmp_path, "env": environment(inject(tmp_path / "inject", NAMED_SOON))}
    with (tmp_path / "said").open("w") as file, program(words, **options, stderr=file) as process:
        named = wait_for(lambda: times_named(tmp_path / "said", 3), "its name", process)
        (tmp_path / "opened").touch()
        assert process.wait(HANG) == 0
    rank, host, string, sample, _ = named
    assert (rank, bool(host)) == ("1", True)
    assert int(string) < 8
    assert int(sample) < 8
    assert_sound(tmp_path / "own.h5")


def times_named(path, times):
    """Return what was said of the sample named last, when it was as often as given.

    On a busy machine others may take half a second, too.
    """
    found = re.findall(
        r"rank (\d+) on (\S+): string (\d+) sample (\d+) has been under way for (\d+) s, and .*; "
        r"stopping\.max_seconds ends samples that take too long",
        path.read_text(),
    )
    last = [each for each in found if each[:4] == found[-1][:4]]
    return last[-1] if len(last) >= times else None
