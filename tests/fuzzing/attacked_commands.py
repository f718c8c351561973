"""Commands in this process, as from a terminal, and what holds of each whatever it is given."""

import io
import re
import resource
import signal
import sys
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import Phase
from processes import signal_handlers_kept

from agglom_mpi.cli import main
from agglom_mpi.cli.common import launch
from agglom_mpi.cli.invert import invert_command
from agglom_mpi.errors import (
    BAD_INPUT,
    BROKEN_PIPE,
    FAILURE,
    FINISHED,
    INTERRUPTED,
    STOPPED,
)

SECONDS = 5.0
"""Processor time after which a command hangs; it does not depend on what else runs."""
ROOM = 700 << 20
"""Bytes that a command may take beside what the process has, so that both are below 1 GB."""
PHASES = (Phase.generate, Phase.shrink)
"""Of Hypothesis; to explain a failure it traces every line, which takes longer than `SECONDS`."""
MOST_LINES, LONGEST_LINE = 20 + len(main.commands), 600
"""Of what a command says on standard error; the longest text is the help of `agglom`, which has a
line for each of its commands."""
DOCUMENTED = {FINISHED, FAILURE, BAD_INPUT, STOPPED, INTERRUPTED, BROKEN_PIPE}
UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
FAILED_SAMPLE = re.compile(r"^rank 0 on \S+: string \d+ sample \d+ raised$", re.MULTILINE)
OUT_OF_MEMORY = re.compile(r"Unable to allocate|MemoryError|campaign file \(\)")


class Hang(BaseException):
    """A command takes too long."""


class Ended(NamedTuple):
    """Exit code of a command, and what it wrote."""

    code: int
    said: str
    errors: str


def _hang(number, frame):
    raise Hang


@contextmanager
def limited():
    """Bound processor time and memory of a block."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    before = signal.signal(signal.SIGPROF, _hang)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + ROOM, hard))
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.signal(signal.SIGPROF, before)


class Commands:
    """Runs commands in a working folder.

    Parameters
    ----------
    folder
        Has what they may read and change.
    """

    def __init__(self, folder):
        self.folder = folder

    def load(self, *words):
        """Run a sound command line, which loads and compiles all that it needs."""
        ended = self._run(words)
        assert ended.code == FINISHED, ended.errors

    def run(self, *words):
        """Run a command line within limits; assert what holds of all of them."""
        try:
            with limited():
                ended = self._run(words)
        except Hang:
            raise AssertionError(f"{words} hangs") from None
        assert_in_words(ended, longest=LONGEST_LINE + 4 * max(map(len, words)))
        return ended

    def _run(self, words):
        said, errors = (io.TextIOWrapper(io.BytesIO(), "utf-8") for _ in range(2))
        inverts = words[0] == invert_command.name
        command = invert_command if inverts else main
        with (
            signal_handlers_kept(),
            pytest.MonkeyPatch.context() as patch,
            redirect_stdout(said),
            redirect_stderr(errors),
        ):
            patch.setattr(sys, "argv", [str(word) for word in words])
            try:
                launch(command, simulates=inverts or words[1:2] == ("accuracy",))
            except SystemExit as end:
                code = end.code
        return Ended(code, *(stream.buffer.getvalue().decode() for stream in (said, errors)))


def assert_in_words(ended, longest):
    """Assert that a command ended as documented, and said why in bounded plain text.

    A word of the command line may be quoted in full, its characters escaped.
    """
    assert ended.code in DOCUMENTED
    if FAILED_SAMPLE.search(ended.errors):  # of a run, is shown with its traceback
        return
    assert "Traceback" not in ended.errors
    assert not OUT_OF_MEMORY.search(ended.said + ended.errors)
    assert not UNPRINTABLE.search(ended.said + ended.errors)
    lines = ended.errors.splitlines()
    assert len(lines) <= MOST_LINES
    assert max(map(len, lines), default=0) <= longest
    if ended.code == BAD_INPUT:
        assert ended.errors.strip()
