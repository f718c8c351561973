"""Runs that simulate so many samples and then wait, on any machine, however busy.

Of how many stands in a file `allowed` in the folder of the run; without it, of all.
"""

import os
import time
from pathlib import Path

from agglom_mpi.runtime import task_runner
from agglom_mpi.runtime.task_runner import Task

_CODE = """
import sys
sys.path.append({path!r})
import held_runs
held_runs.hold({pace})
{text}
"""


def allow(folder, samples):
    """Let each rank of a run in a folder simulate so many samples since its start, and no more."""
    new = Path(folder, "allowed.new")
    new.write_text(str(samples))
    os.replace(new, Path(folder, "allowed"))


def allow_all(folder):
    """Let runs in a folder go on to their end."""
    Path(folder, "allowed").unlink()


def hold(pace):
    """Hold the runs of this process; every sample takes so many seconds more.

    A run that waits has handed over what it has done, and can be stopped.
    """
    simulate_next, done = Task.simulate_next, 0

    def simulate_if_allowed(task, seconds):
        nonlocal done
        try:
            allowed = int(Path("allowed").read_text())
        except FileNotFoundError:
            allowed = done + 1
        if done >= allowed:
            time.sleep(0.002)
            return not task._abort_flag.stopped
        time.sleep(pace)
        done += 1
        return simulate_next(task, seconds)

    Task.simulate_next, task_runner.MAX_AT_ONCE = simulate_if_allowed, 1


def held(folder, pace=0.0, text=""):
    """Return a folder to inject into runs in a folder: they are held, and execute a text."""
    path = folder / "held"
    path.mkdir(exist_ok=True)
    code = _CODE.format(path=str(Path(__file__).parent), pace=pace, text=text)
    (path / "sitecustomize.py").write_text(code)
    return path
