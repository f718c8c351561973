"""Runs that Python starts: in this process, or by ranks of their own under `mpirun`."""

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.display.run_display import Display
from agglom_mpi.errors import FINISHED, STOPPED, UserError
from agglom_mpi.launcher import rank_variables
from agglom_mpi.runtime.file_setup import output_path
from agglom_mpi.runtime.invert import InvertOptions, request_for
from agglom_mpi.runtime.run import run_this_rank
from agglom_mpi.runtime.stop_request import StopRequest

STOPS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP)
"""Signals that ask a run to stop."""
LAST_LINES: Final = 20
"""Number of last lines of ranks that failed which the error has."""
COMMAND: Final = "from agglom_mpi.cli import invert; invert()"


class RunFailedError(UserError, RuntimeError):
    """A run ended by an error; its text is what the run said."""


def run_here(campaign: Campaign, options: InvertOptions) -> Path:
    """Run a campaign in this process; return the path of its file.

    Raises
    ------
    RunFailedError
        If the run ends by an error.
    """
    display = Told(options.quiet)
    request = request_for(campaign, options, display.message)
    with stop_request(options.max_walltime) as stop:
        code = run_this_rank(lambda: request, display, lambda request: None, stop, None)
    check_end(code, display.errors)
    return request.path


def run_by_ranks(campaign: Campaign, options: InvertOptions, ranks: int) -> Path:
    """Run a campaign by ranks that `mpirun` starts; return the path of its file.

    Raises
    ------
    RunFailedError
        If the run ends by an error.
    """
    path = output_path(campaign, options.output)
    invert = [sys.executable, "-c", COMMAND, campaign.name, "--output", path]
    words = [launcher(), "-n", ranks, *invert]
    words += ["--quiet"] * options.quiet + ["--allow-code"] * options.allow_code
    if options.max_walltime is not None:
        words += ["--max-walltime", f"{options.max_walltime:g}s"]
    check_end(*follow([*map(str, words)]))
    return path


class Told(Display):
    """A display that keeps errors, which are raised instead of shown.

    Attributes
    ----------
    errors
        Their texts.
    """

    def __init__(self, quiet: bool) -> None:
        super().__init__(quiet)
        self.errors: list[str] = []

    def error(self, text: str) -> None:
        """Keep an error."""
        self.errors.append(text)


class UnsignalledStop(StopRequest):
    """A request to stop in a thread that gets no signals."""

    def listen(self) -> None:
        """Do nothing: signals are for the main thread."""

    def do_unless_stopped(self, work: Callable[[], object]) -> None:
        """Do work to its end, unless there is a reason to stop already."""
        if not self.reason:
            work()


@contextmanager
def stop_request(max_walltime: float | None) -> Iterator[StopRequest]:
    """Give a request to stop by signals, where this thread gets them, and put handlers back."""
    if threading.current_thread() is not threading.main_thread():
        yield UnsignalledStop(max_walltime)
        return
    handlers = {number: signal.getsignal(number) for number in STOPS}
    try:
        yield StopRequest(max_walltime)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def launcher() -> Path | str:
    """Return the `mpirun` of this installation, else the first on the path.

    Raises
    ------
    RunFailedError
        If there is none.
    """
    own = Path(sys.executable).parent / "mpirun"
    found = own if own.exists() else shutil.which("mpirun")
    if found is None:
        raise RunFailedError("ranks need mpirun: pip install 'agglom_mpi[mpi]'")
    return found


def follow(words: list[str]) -> tuple[int, list[str]]:
    """Run a command, passing its standard error on; its exit code and the last lines of that.

    An interrupt is passed on as a request to stop.
    """
    ranks = rank_variables()  # of this process, which may be a rank itself
    environment = {name: value for name, value in os.environ.items() if name not in ranks}
    last: deque[str] = deque(maxlen=LAST_LINES)
    process = subprocess.Popen(
        words,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stderr is not None
    with process:
        while True:
            try:
                for line in process.stderr:
                    last.append(line.rstrip())
                    print(line, end="", file=sys.stderr, flush=True)
                return process.wait(), list(last)
            except KeyboardInterrupt:
                process.send_signal(signal.SIGINT)


def check_end(code: int, said: list[str]) -> None:
    """Raise a RunFailedError if a run has neither finished nor stopped."""
    if code not in (FINISHED, STOPPED):
        raise RunFailedError("\n".join(said) or f"the run ended with code {code}")
