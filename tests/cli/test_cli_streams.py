"""Standard output and error that are closed, or that nobody reads any more."""

import os
import re
import sys
from pathlib import Path

import pytest
from campaign_runs import environment, state
from processes import output_of, program

from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.storage.reader import read_campaign

BIN = Path(sys.executable).parent


@pytest.fixture
def shell(tiny_folder, tmp_path):
    """Return a function that runs a line of shell; exit code and what it wrote to `2>` files."""
    (tmp_path / "tiny.h5").write_bytes((tiny_folder / "tiny.h5").read_bytes())
    (tmp_path / "tiny.yaml").write_text((tiny_folder / "tiny.yaml").read_text())

    def run(line):
        words = ["bash", "-c", f"PATH={BIN}:$PATH; {line}"]
        with program(words, cwd=tmp_path, env=environment()) as process:
            said, errors = output_of(process)
        assert "Traceback" not in errors
        assert "Exception ignored" not in errors
        return process.returncode, said, errors

    run.folder = tmp_path
    return run


SLOW = pytest.mark.slow
READING = [
    "agglom report tiny.h5",
    pytest.param("agglom report tiny.h5 --json", marks=SLOW),
    pytest.param("agglom check tiny.h5", marks=SLOW),
]


@pytest.mark.parametrize("command", [*READING, pytest.param("agglom --help", marks=SLOW)])
def test_a_broken_pipe_ends_a_command_that_reads_quietly(shell, command):
    # The other end of the pipe is closed before the command begins.
    _, said, errors = shell(f"exec 3> >(:); wait $!; {command} >&3; echo $? >&2")
    assert (said, errors) == ("", "141\n")


@pytest.mark.slow(guard="cli/test_cli_streams.py::test_a_run_goes_on_without_its_output")
@pytest.mark.parametrize("command", READING)
def test_a_closed_output_is_as_good_as_none(shell, command):
    assert shell(f"{command} >&- 2>&- <&-") == (0, "", "")


@pytest.mark.parametrize("command", READING)
def test_output_that_finds_no_room_is_one_message(shell, command):
    code, _, errors = shell(f"{command} > /dev/full")
    assert code in (1, 2)
    assert re.fullmatch(r".*standard output: No space left on device\n", errors)


LOST = [
    pytest.param("2>&-", id="errors closed", marks=SLOW),
    pytest.param("<&- >&- 2>&-", id="all closed"),
    pytest.param("2>&1 | true; exit ${PIPESTATUS[0]}", id="nobody reads", marks=SLOW),
    pytest.param("> /dev/full 2>&1", id="no room", marks=SLOW),
]


@pytest.mark.parametrize("lost", LOST)
def test_a_run_goes_on_without_its_output(shell, lost):
    code, _, errors = shell(f"agglom-invert tiny.yaml -o new.h5 {lost}")
    assert (code, errors) == (0, "")
    assert state(shell.folder / "new.h5")[0] == "finished"
    new, old = (read_campaign(shell.folder / name) for name in ("new.h5", "tiny.h5"))
    assert new.result_rows().tobytes() == old.result_rows().tobytes()
    # Without precaution, the first files to be opened would be standard output and error.
    text, code = check_file(str(new.path))
    assert code == 0, text
    assert os.path.getsize(new.path) == os.path.getsize(old.path)


@pytest.mark.slow(guard="cli/test_cli_streams.py::test_a_run_goes_on_without_its_output")
def test_a_stopped_run_without_its_output_has_its_own_exit_code(shell):
    line = "agglom-invert tiny.yaml -o new.h5 --max-walltime 0.001 2>&-"
    assert shell(line)[0] == 75
    assert state(shell.folder / "new.h5")[0] == "stopped"
