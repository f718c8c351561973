"""Programs that tests start: in groups of their own, and gone when the test is over."""

import os
import signal
import subprocess
import time
from contextlib import contextmanager

import psutil

HANG = 300.0
"""Seconds after which something hangs, on a machine however busy."""


def wait_for(condition, what, process=None, seconds=HANG):
    """Wait until a condition holds and return what it gave.

    `what` is waited for, in words. A `process`, if given, must not end before. The seconds only
    bound a hang.
    """
    end = time.monotonic() + seconds
    while not (found := condition()):
        ended = process is not None and process.poll() is not None
        if ended and not (found := condition()):
            said = process.communicate(timeout=seconds)[1] if process.stderr else ""
            raise AssertionError(f"ended with {process.returncode} before {what}\n{said}")
        if ended:
            return found
        assert time.monotonic() < end, f"no {what}"
        time.sleep(0.01)
    return found


@contextmanager
def signal_handlers_kept():
    """Put the handlers of signals that ask a run to stop back after a run in this process."""
    stops = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP)
    handlers = {number: signal.getsignal(number) for number in stops}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def wait_until_gone(numbers):
    """Wait for the end of processes."""
    left = [psutil.Process(number) for number in numbers if psutil.pid_exists(number)]
    _, living = psutil.wait_procs(left, timeout=HANG)
    assert not living, "a rank outlives the job"


def start_group(command, **options):
    """Start a program as the leader of a new session and so of a process group."""
    words = [str(word) for word in command]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | options
    return subprocess.Popen(words, start_new_session=True, **options)


def descendants(process):
    """Return the processes that a program, by itself or by others, has started."""
    try:
        return psutil.Process(process.pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return []


def end_group(process):
    """Kill a program and all it has started, and close its pipes."""
    started = descendants(process)
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    for one in started:
        try:
            one.kill()
        except psutil.NoSuchProcess:
            continue
    psutil.wait_procs(started, timeout=HANG)
    process.wait(timeout=HANG)
    for pipe in (process.stdin, process.stdout, process.stderr):
        if pipe is not None:
            pipe.close()


@contextmanager
def program(command, **options):
    """Start a program that does not outlive the block, nor does what it has started."""
    process = start_group(command, **options)
    try:
        yield process
    finally:
        end_group(process)


def output_of(process):
    """Wait for the end of a program; its standard output and standard error."""
    return process.communicate(timeout=HANG)
