"""Signals, walltime and other reasons to stop a run."""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

PATIENCE: Final = 1.0
"""Seconds after the first signal during which another INT is the same request, not a new one."""


class _BrokenOff(BaseException):
    """A stop was requested during work that cannot ask for it."""


class StopRequest:
    """Whether to stop early, by a signal or the walltime, and why.

    Launchers, batch systems and shells send a signal several times, or several signals. The first
    one is the request, and the others are ignored while the run stops. A later INT is somebody who
    does not want to wait: it raises KeyboardInterrupt, and the next one kills.

    Parameters
    ----------
    max_walltime
        Time in s after which to stop; None without a limit.
    """

    def __init__(self, max_walltime: float | None = None) -> None:
        self._reason = ""
        self._signalled: float | None = None
        self._breaks_off = False
        self._deadline = None if max_walltime is None else time.monotonic() + max_walltime

    def listen(self) -> None:
        """Take the signals INT, TERM and USR1 as requests to stop, and HUP unless under nohup.

        Other threads than the main one get no signals, and do not listen.
        """
        if _gets_signals():
            for number in stop_signals():
                signal.signal(number, self._on_signal)

    def request(self, reason: str) -> None:
        """Ask for a stop, from any thread."""
        self._reason = self._reason or reason

    @property
    def reason(self) -> str:
        """The reason to stop, as text; empty while there is none."""
        if not self._reason and self._deadline is not None and time.monotonic() >= self._deadline:
            self._reason = "the walltime limit is reached"
        return self._reason

    def do_unless_stopped(self, work: Callable[[], object]) -> None:
        """Do work that cannot ask for the reason; a stop breaks it off, wherever it is.

        In another thread than the main one nothing breaks it off.
        """
        if self.reason:
            return
        if not _gets_signals():
            work()
            return
        previous = signal.signal(signal.SIGALRM, self._on_signal)
        if self._deadline is not None:
            left = max(1e-3, self._deadline - time.monotonic())
            signal.setitimer(signal.ITIMER_REAL, left)
        try:
            try:
                self._breaks_off = True
                work()
            finally:
                self._breaks_off = False
        except _BrokenOff:
            self._breaks_off = False  # it may have come just before the line above
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, previous)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if number == signal.SIGALRM:
            if self._breaks_off and self.reason:
                raise _BrokenOff
            return
        if self._signalled is None:
            self._signalled = now
            self._reason = self._reason or f"received {signal.Signals(number).name}"
            if self._breaks_off:
                raise _BrokenOff
        elif number == signal.SIGINT and now - self._signalled > PATIENCE:
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            raise KeyboardInterrupt


def interrupt_on_signals() -> None:
    """Let these signals raise KeyboardInterrupt, as INT does, until there is something to stop."""
    for number in stop_signals():
        signal.signal(number, signal.default_int_handler)


def ignore_signals() -> None:
    """Ignore these signals from now on.

    So does a rank other than 0: rank 0 gets them too, and stops the others. So does a process at
    its end: Python takes its handlers away then, and a signal would kill it.
    """
    for number in stop_signals():
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def handlers_kept() -> Iterator[None]:
    """Put the handlers of these signals back at the end, where this thread may set them."""
    handlers = {number: signal.getsignal(number) for number in stop_signals()}
    try:
        yield
    finally:
        if _gets_signals():
            for number, handler in handlers.items():
                signal.signal(number, handler)


def _gets_signals() -> bool:
    return threading.current_thread() is threading.main_thread()


def stop_signals() -> list[signal.Signals]:
    """Return the signals that ask for a stop; a HUP that is ignored already, as nohup does, not."""
    found = [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        found.append(signal.SIGHUP)
    return found
