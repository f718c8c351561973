"""Signals, walltime and other reasons to stop a run."""

import signal
import time
from types import FrameType


class StopRequest:
    """Whether to stop early, by a signal or the walltime, and why.

    Parameters
    ----------
    max_walltime
        Time in s after which to stop; None without a limit.
    """

    def __init__(self, max_walltime: float | None = None) -> None:
        self._reason = ""
        self._deadline = None if max_walltime is None else time.monotonic() + max_walltime

    def listen(self) -> None:
        """Take the signals INT, TERM and USR1 as requests to stop, and HUP unless under nohup."""
        for number in _signals():
            signal.signal(number, self._on_signal)

    @property
    def reason(self) -> str:
        """The reason to stop, as text; empty while there is none."""
        if not self._reason and self._deadline is not None and time.monotonic() >= self._deadline:
            self._reason = "the walltime limit is reached"
        return self._reason

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._reason = f"received {signal.Signals(number).name}"


def ignore_signals() -> None:
    """Ignore these signals on this rank: rank 0 gets them too, and stops the others."""
    for number in _signals():
        signal.signal(number, signal.SIG_IGN)


def _signals() -> list[signal.Signals]:
    """Return the signals that ask for a stop; a HUP that is ignored already, as nohup does, not."""
    found = [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        found.append(signal.SIGHUP)
    return found
