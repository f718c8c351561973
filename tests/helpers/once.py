"""What all workers of a test run share: made once, by whoever needs it first."""

import fcntl
import os
from contextlib import contextmanager

from drawing import note_drawing


def shared_folder(tmp_path_factory):
    """Return the folder that all workers of this run have in common."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


@contextmanager
def locked(path):
    """Hold a lock that is a file, for a block; other processes wait."""
    with open(path, "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def made_once(folder, make):
    """Return a folder, filled by `make(folder)` unless another worker has done so."""
    note_drawing()
    with locked(folder.with_name(f"{folder.name}.lock")):
        done = folder / "done"
        if not done.exists():
            folder.mkdir()
            make(folder)
            done.touch()
    return folder
