"""Runs that Python starts: in this process, or by ranks of their own under `mpirun`."""

import os
import signal
import subprocess
import sys
from collections import deque
from pathlib import Path
from typing import Final

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.display.run_display import Display
from agglom_mpi.errors import FINISHED, STOPPED, UserError
from agglom_mpi.launcher import find_launcher, python_command, without_rank_variables
from agglom_mpi.runtime.file_setup import output_path
from agglom_mpi.runtime.invert import InvertOptions, request_for
from agglom_mpi.runtime.own_code_notes import notes_left
from agglom_mpi.runtime.run import run_this_rank
from agglom_mpi.runtime.stop_request import StopRequest, handlers_kept
from agglom_mpi.scheduling.interface import volume_string

LAST_LINES: Final = 20
"""Number of last lines of ranks that failed which the error has."""
ENDS_WITH_PARENT: Final = """
import ctypes, os, signal, sys
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, signal.SIGINT)  # PR_SET_PDEATHSIG
    if os.getppid() != int(sys.argv[1]):
        sys.exit(1)
os.execv(sys.argv[2], sys.argv[2:])
"""
"""Program that becomes the one of its arguments, which is asked to stop when its parent ends."""
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
    stop = StopRequest(options.max_walltime)
    with handlers_kept():
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
    path, launcher = (
        output_path(campaign, options.output),
        find_launcher(os.environ, own_first=True),
    )
    if launcher is None:
        raise RunFailedError("ranks need mpirun: pip install 'agglom_mpi[mpi]'")
    invert = [*python_command(COMMAND), campaign.name, "--output", path]
    words = [launcher, "-n", ranks, *invert]
    words += ["--quiet"] * options.quiet + ["--allow-code"] * options.allow_code
    if options.max_walltime is not None:
        words += ["--max-walltime", f"{options.max_walltime:g}s"]
    code, said = follow([*map(str, words)])
    if code not in (FINISHED, STOPPED) and (noted := notes_left(path)):
        begun = ", ".join(f"string {volume_string(i).text} sample {k}" for i, k in noted)
        said.append(f"begun last, where code of your own runs: {begun}; run again to find which")
    check_end(code, said)
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


def follow(words: list[str]) -> tuple[int, list[str]]:
    """Run a command, passing its standard error on; its exit code and the last lines of that.

    An interrupt is passed on as a request to stop, and so is the end of this process.
    """
    last: deque[str] = deque(maxlen=LAST_LINES)
    process = subprocess.Popen(
        [*python_command(ENDS_WITH_PARENT), str(os.getpid()), *words],
        env=without_rank_variables(os.environ),  # this process may be a rank itself
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
