"""A disc that is full or a quota that is used up, at any call: one message, a whole file, a resume.

`pytest tests/crash/test_crash_faults.py --many 500` lets 500 calls fail, or all, each once by
itself and once with all that follow it.
"""

import errno
import os
import shutil

import pytest
from campaign_runs import assert_same, assert_sound, decisions, finish, write_campaign
from crash_rows import final_rows
from faulty_runs import FOREVER, compiled, faulty_runs

from agglom_mpi.storage.verify import verify_rows

NUMBERS = {"particles": 10, "generations": 4, "max_samples": 12, "population": 8, "parents": 2}
"""Of a campaign with so few samples, and particles, that a run takes a moment."""
CASES = ["begun", "enlarged"]
"""A run that begins, and one whose file grows."""
FAILURES = 8
"""Calls that are let fail, spread evenly, unless more are asked for."""
COMMAND = ["small.yaml", "-q"]
LOCKING = range(2, 5)
"""Calls that write into the lock file, of which only the name counts."""


@pytest.fixture(scope="module")
def starts(tmp_path_factory):
    """Return a folder with a campaign and the files that runs begin with, `begun` with none.

    `enlarged.h5` has room for one generation, `finished.h5` is what every run must come to.
    """
    folder = tmp_path_factory.mktemp("disc")
    write_campaign(folder / "small.yaml", **NUMBERS)
    finish(folder, "small.yaml", "--output", "finished.h5")
    finish(folder, "small.yaml", "--output", "enlarged.h5", "--generations", "1")
    return folder


@pytest.fixture(scope="module")
def run_faulty(starts):
    """Return a function that runs the campaign on a disc that fills up."""
    with faulty_runs(compiled(starts), starts / "small.yaml") as run:
        yield run


def failures(calls, count):
    """Yield the first and the last call that fails, with the error: it alone, then all from it."""
    step = max(1, calls // count)
    for index, first in enumerate(range(1, calls + 1, step)):
        error = errno.EDQUOT if index % 3 == 2 else errno.ENOSPC
        yield first, first, error
        yield first, FOREVER, error


def begin(starts, start, folder):
    """Return the new `folder` with the campaign and, where there is one, the file `start`."""
    folder.mkdir()
    shutil.copy(starts / "small.yaml", folder)
    if start.exists():
        shutil.copy(start, folder / "small.h5")
    return folder


def lacks_only_its_status(path):
    """Whether the disc took half of a status; a resume writes it again."""
    report = verify_rows(path)
    return not report.faults and {name for name in report.lost if report.lost[name]} == {"status"}


def check_end(done, path, before, full):
    """Check what a run that began with the final rows `before` says and leaves; `full` is why."""
    names = {each.name for each in path.parent.iterdir()}
    assert names <= {"small.yaml", "small.h5", ".small.h5.lock"}
    if path.exists() and not lacks_only_its_status(path):
        assert_sound(path)
    rest = "everything written before is whole, run again to go on"
    if done.code == 0:
        assert done.errors == ""
    elif done.code == 1:
        assert done.errors == f"{path}: {full}; {rest}\n"
    else:
        lock = path.with_name(".small.h5.lock")
        assert done.errors in (f"{path}: {full}\n", f"{lock}: {full}\n")
        assert final_rows(path) == before


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_a_disc_that_is_full_at_any_call_leaves_a_whole_file(
    starts, run_faulty, tmp_path, case, request
):
    start, wanted, codes = starts / f"{case}.h5", decisions(starts / "finished.h5"), []
    calls = run_faulty(begin(starts, start, tmp_path / "whole"), FOREVER, FOREVER, *COMMAND).calls
    for first, last, error in failures(calls, request.config.getoption("--many") or FAILURES):
        folder = begin(starts, start, tmp_path / f"call-{first}-{last}")
        path = folder / "small.h5"
        done = run_faulty(folder, first, last, *COMMAND, error=error)
        # Samples that end together are written together, so a run may end before that call.
        may_pass = first in LOCKING or done.calls < first
        assert done.code in ((0, 1, 2) if may_pass else (1, 2)), first
        check_end(done, path, final_rows(start), os.strerror(error))
        rows = final_rows(path)
        finish(folder, *COMMAND)
        now = final_rows(path)
        assert [key for key, row in rows.items() if now[key] != row] == []
        assert_same(path, wanted)
        codes.append(done.code)
        shutil.rmtree(folder)
    assert codes.count(0) < len(codes) / 2
    counts = {code: codes.count(code) for code in sorted(set(codes))}
    print(f"{case}: {len(codes)} full discs, by exit code {counts}")
