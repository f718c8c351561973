"""Runs that say what they are doing with the campaign file, and wait at a moment to be killed.

A moment is a step of an activity: before every write of rows, or of bytes of a new file, and at the
end. Whoever reaches step number `wanted.step` of the activity `wanted.activity` waits there.
"""

import json
import os
import threading
import time
from contextlib import contextmanager
from functools import wraps
from pathlib import Path

ACTIVITIES = ("creation", "growth", "samples", "decisions", "generation", "closing")
"""What a run does with its file; the rest of the time it simulates, or nothing."""
ELSE = "else"


def want(folder, activity=None, step=0):
    """Let runs in a folder wait at a step of an activity, from 0, or go on without waiting."""
    Path(folder, "reached").unlink(missing_ok=True)
    Path(folder, "activity").unlink(missing_ok=True)
    Path(folder, "wanted").write_text(json.dumps([activity, step]))


def reached(folder):
    """Whether a run waits at the moment that is wanted."""
    return Path(folder, "reached").exists()


def activity_of(folder):
    """Return what the rank that wrote last was doing with the file."""
    path = Path(folder, "activity")
    return (path.read_text() if path.exists() else "") or ELSE


class _Moments:
    """The activities under way in this process, and the steps of that which is wanted."""

    def __init__(self):
        self._wanted, self._step = json.loads(Path("wanted").read_text())
        self._under_way = []
        self._main = threading.main_thread()

    def step(self):
        if not self._under_way or self._under_way[-1] != self._wanted:
            return
        if self._step == 0:
            Path("reached").touch()
            while True:
                time.sleep(1.0)
        self._step -= 1

    @contextmanager
    def during(self, activity):
        self._under_way.append(activity)
        self._tell()
        try:
            yield
            if self._under_way.count(activity) == 1 and activity in ("creation", "growth"):
                self._step = 0 if activity == self._wanted else self._step
            self.step()
        finally:
            self._under_way.pop()
            self._tell()

    def _tell(self):
        if threading.current_thread() is self._main:
            new = f"activity-{os.getpid()}"
            Path(new).write_text(self._under_way[-1] if self._under_way else "")
            os.replace(new, "activity")


def install():
    """Let this process tell its activities, and wait where it is to be killed."""
    from agglom_mpi.runtime import file_setup
    from agglom_mpi.storage import files, row_buffer, rows, writer

    moments = _Moments()

    def stepping(owner, name):
        function = getattr(owner, name)

        @wraps(function)
        def wrapped(*arguments, **options):
            moments.step()
            return function(*arguments, **options)

        setattr(owner, name, wrapped)

    def telling(owner, name, activity):
        function = getattr(owner, name)

        @wraps(function)
        def wrapped(*arguments, **options):
            with moments.during(activity):
                return function(*arguments, **options)

        setattr(owner, name, wrapped)

    for owner, name in ((rows.Rows, "write"), (files.CheckedFile, "write"), (files, "sync")):
        stepping(owner, name)
    telling(file_setup, "create_campaign_file", "creation")
    telling(file_setup, "enlarge_campaign_file", "growth")
    telling(row_buffer.SampleWriter, "flush", "samples")
    telling(writer.CampaignWriter, "put_strings", "decisions")
    telling(writer.CampaignWriter, "flush", "decisions")
    telling(writer.CampaignWriter, "put_generation", "generation")
    telling(writer.RunLog, "end_leg", "closing")
    telling(writer.CampaignWriter, "close", "closing")
