"""A pytest plugin: the run fails if it leaves a process, a temporary folder or a file behind.

Every process that a test starts inherits a variable that names the run, whatever becomes of its
parent or its process group. Temporary files go into a folder of the run's own.
"""

import os
import shutil
import tempfile
import time
from pathlib import Path

import psutil
import pytest

VARIABLE = "AGGLOM_TEST_RUN"
"""Names a folder that belongs to this test run alone."""
_CACHES = {
    ".git",
    ".hypothesis",
    ".import_linter_cache",
    ".mypy_cache",
    ".pytest_cache",
    ".ruff_cache",
    ".venv",
    "__pycache__",
    "build",
}

_SESSIONS = "ompi."
"""How Open MPI names the temporary folder of a launcher, which removes it unless it is killed."""


def files_below(root):
    """Return the paths of all files below a folder, those of tools left out."""
    found = set()
    for folder, folders, files in os.walk(root):
        folders[:] = [n for n in folders if n not in _CACHES and not n.endswith(".egg-info")]
        found.update(os.path.join(folder, name) for name in files)
    return found


def processes_of(run):
    """Return the other processes that a run, or whatever it started, has started.

    A process that has ended but whose parent has not asked for its exit code is not one of them.
    """
    found = []
    for process in psutil.process_iter():
        try:
            if process.environ().get(VARIABLE) == run and process.pid != os.getpid():
                found.append(process)
        except psutil.Error:
            continue
    return found


def _described(process):
    try:
        words, variables = " ".join(process.cmdline()), process.environ()
    except psutil.Error:
        return None
    return f"process {process.pid} of {variables.get('PYTEST_CURRENT_TEST', 'no test')}: {words}"


def end_processes(run, grace):
    """Kill what is left of a run after so many seconds; a line for each process killed."""
    deadline = time.monotonic() + grace
    while (left := processes_of(run)) and time.monotonic() < deadline:
        time.sleep(0.05)
    told = [line for line in map(_described, left) if line is not None]
    while left := processes_of(run):
        for process in left:
            process.kill()
        psutil.wait_procs(left, timeout=1.0)
    return told


class Leftovers:
    """What there was before the run, and what the run has added.

    Parameters
    ----------
    root
        The working tree.
    grace
        Seconds that processes have to end by themselves once the last test is over.
    """

    def __init__(self, root, grace=10.0):
        self._root, self._grace = root, grace
        self._before = files_below(root)
        # Short, because the names of Unix sockets, which launchers make there, are limited.
        self._folder = Path(tempfile.mkdtemp(prefix="agglom-"))
        self._temporary = self._folder / "tmp"
        self._temporary.mkdir()
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", tempfile.gettempdir())
        os.environ[VARIABLE] = str(self._folder)
        os.environ["TMPDIR"] = tempfile.tempdir = str(self._temporary)

    def collect(self):
        """End what still runs and remove the run's temporary folder; a line for each leftover."""
        told = end_processes(str(self._folder), self._grace)
        told += [f"temporary file {name}" for name in self._temporary_files()]
        shutil.rmtree(self._folder)
        return told + [f"file {path}" for path in sorted(files_below(self._root) - self._before)]

    def _temporary_files(self):
        """Return their names, but for the session folders of launchers that tests have killed."""
        names = sorted(path.name for path in self._temporary.iterdir())
        return [name for name in names if not name.startswith(_SESSIONS)]

    @pytest.hookimpl(trylast=True)  # when the workers of pytest-xdist are gone
    def pytest_sessionfinish(self, session):
        """Count a run that leaves something behind as one with an error."""
        told = self.collect()
        if not told:
            return
        if session.exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED
        report = pytest.TestReport(
            nodeid="the whole run",
            location=("", None, "the whole run"),
            keywords={},
            outcome="failed",
            longrepr="left behind:\n" + "\n".join(told),
            when="teardown",
        )
        reporter = session.config.pluginmanager.get_plugin("terminalreporter")
        reporter.stats.setdefault("error", []).append(report)
