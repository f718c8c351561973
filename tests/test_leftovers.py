"""What a test run leaves behind makes it fail, and is gone afterwards."""

import os
import signal
import sys
from pathlib import Path

import psutil
import pytest
from processes import output_of, program, wait_for

CONFTEST = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent / "helpers")!r})
from leftovers import Leftovers

def pytest_configure(config):
    config.pluginmanager.register(Leftovers(config.rootpath, grace=0.2))
"""
DAEMON = """
import subprocess, sys
from pathlib import Path

def start_daemon():
    words = [sys.executable, "-c", "import time; print(0, flush=True); time.sleep(1000)"]
    started = subprocess.Popen(words, start_new_session=True, stdout=subprocess.PIPE)
    started.stdout.readline()
    Path("number").write_text(str(started.pid))
"""


@pytest.fixture
def started(tmp_path):
    """Return a function that starts a run of one test module."""
    (tmp_path / "pytest.ini").write_text("[pytest]\naddopts = -q\n")
    (tmp_path / "conftest.py").write_text(CONFTEST)
    variables = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    for name in ("PYTEST_XDIST_WORKER", "PYTEST_ADDOPTS"):
        variables.pop(name, None)

    def start(text):
        (tmp_path / "test_it.py").write_text(DAEMON + text)
        words = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider"]
        return program(words, cwd=tmp_path, env=variables)

    return start


def daemon_number(folder):
    """Return the number of the daemon's process as text, empty until it is written."""
    path = folder / "number"
    return path.read_text() if path.exists() else ""


def daemon_is_gone(folder):
    number = int(daemon_number(folder))
    return not psutil.pid_exists(number) or psutil.Process(number).status() == "zombie"


def test_a_clean_run_passes(started):
    with started("def test_nothing(): pass") as run:
        said, _ = output_of(run)
    assert run.returncode == 0, said
    assert said.splitlines()[-1].startswith("1 passed")


def test_a_daemon_fails_the_run_is_named_and_ended(started, tmp_path):
    with started("def test_one(): start_daemon()") as run:
        said, _ = output_of(run)
        assert daemon_is_gone(tmp_path)
    assert run.returncode == 1, said
    assert "test_it.py::test_one (call): " in said
    assert "time.sleep(1000)" in said
    assert said.splitlines()[-1].startswith("1 passed, 1 error")


@pytest.mark.parametrize(
    ("leave", "line"),
    [
        ("import tempfile; tempfile.mkdtemp(prefix='mine-')", "temporary file mine-"),
        pytest.param("open('left.txt', 'w').close()", "left.txt", marks=pytest.mark.slow),
    ],
)
def test_a_file_fails_the_run(started, leave, line):
    with started(f"def test_one(): {leave}") as run:
        said, _ = output_of(run)
    assert run.returncode == 1, said
    assert line in said


def test_ctrl_c_in_the_middle_leaves_no_process(started, tmp_path):
    endless = "def test_one():\n    start_daemon()\n    import time; time.sleep(1000)"
    with started(endless) as run:
        wait_for(lambda: daemon_number(tmp_path), "daemon", run)
        os.killpg(run.pid, signal.SIGINT)
        said, _ = output_of(run)
        assert daemon_is_gone(tmp_path)
    assert run.returncode == 2, said
