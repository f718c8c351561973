"""Limits on memory, files, threads and the size of files, and a clock that is set back."""

import os
import shutil

import pytest
from campaign_runs import (
    assert_same,
    assert_sound,
    environment,
    finish,
    injected,
)
from click.testing import CliRunner
from processes import output_of, program

from agglom_mpi.cli import main
from agglom_mpi.storage.reader import read_campaign

NOBODY = "54321"
"""A user who has no other processes: limits on their number are those of a user, not of root."""
SET_BACK = """
import time

now, calls = time.time, 0

def an_hour_earlier():
    global calls
    calls += 1
    return now() - 3600.0 * (calls > 50)

time.time = an_hour_earlier
"""


def limited(folder, limit, *before):
    """Exit code and standard error of a run under a `ulimit`, started by the words `before`."""
    words = ["bash", "-c", f'ulimit {limit}; exec "$@"', "bash", "agglom-invert", "small.yaml"]
    with program([*before, *words, "-q"], cwd=folder, env=environment()) as process:
        _, errors = output_of(process)
    assert "Traceback" not in errors
    if (folder / "small.h5").exists():
        assert_sound(folder / "small.h5")
    return process.returncode, errors


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        ("-v 400000", "ulimit -v allows 390 MiB of memory; a simulation needs at least 512 MiB\n"),
        pytest.param("-f 64", "small.h5: File too large\n", marks=pytest.mark.slow),
    ],
)
def test_a_limit_on_memory_or_file_size_is_one_message_and_no_file(folder, limit, said):
    code, errors = limited(folder, limit)
    assert (code, errors.count("\n")) == (2, 1), errors
    assert errors.endswith(said)
    assert {path.name for path in folder.glob("*small.h5*")} <= {".small.h5.lock"}


@pytest.mark.slow
@pytest.mark.parametrize("files", [6, 16])
def test_a_limit_on_open_files_is_one_message_or_none(folder, wanted, files):
    code, errors = limited(folder, f"-n {files}")
    assert (code, errors.count("\n")) in ((0, 0), (1, 1), (2, 1)), errors
    assert (code == 0) or "Too many open files" in errors
    finish(folder, "small.yaml")
    assert_same(folder / "small.h5", wanted)


@pytest.mark.slow
def test_a_limit_on_threads_is_one_message(folder, wanted):
    if os.geteuid() or not shutil.which("setpriv"):
        pytest.skip("another user can be made by a superuser with setpriv")
    folder.chmod(0o777)
    # Who may still read what root may: the interpreter may lie in root's home.
    access = ["--inh-caps=+dac_override", "--ambient-caps=+dac_override"]
    user = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups", *access]
    code, errors = limited(folder, "-u 1", *user)
    assert (code, errors.count("\n")) == (1, 1), errors
    assert "no more threads are allowed here (ulimit -u)" in errors
    os.remove(folder / ".small.h5.lock")  # it is the other user's
    finish(folder, "small.yaml")
    assert_same(folder / "small.h5", wanted)


def test_a_clock_that_is_set_back_makes_no_time_negative(folder, wanted):
    with injected(SET_BACK, "time.time"):
        finish(folder, "small.yaml")
    path = folder / "small.h5"
    [leg] = read_campaign(path).legs()
    assert leg["stopped"] >= leg["started"]
    assert_same(path, wanted)
    assert_sound(path)
    shown = CliRunner().invoke(main, ["report", str(path)])
    assert shown.exit_code == 0, shown.output
    assert " -" not in shown.stdout.split("generations, ")[-1].partition("samples/s")[0]
