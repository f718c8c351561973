"""The commands `agglom`, run in the process of the tests."""

import subprocess
from contextlib import chdir

from click.testing import CliRunner
from core_seconds import spent_on
from processes import signal_handlers_kept

from agglom_mpi.cli import main


def agglom_here(folder, *arguments):
    """Run `agglom` in a folder as a process of its own would; exit code and what it said."""
    words = list(map(str, arguments))
    with spent_on("campaigns"), signal_handlers_kept(), chdir(folder):
        done = CliRunner().invoke(main, words, prog_name="agglom")
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return subprocess.CompletedProcess(words, done.exit_code, done.stdout, done.stderr)
