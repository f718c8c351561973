"""Commands, run in the process of the tests as processes of their own would."""

import subprocess
from contextlib import chdir

from click.testing import CliRunner
from core_seconds import spent_on
from processes import signal_handlers_kept

from agglom_mpi.cli import main


def agglom_here(folder, *arguments):
    """Run `agglom` in a folder; exit code and what it said."""
    return run_here(main, "agglom", folder, arguments)


def run_here(command, name, folder, arguments):
    """Run a command in a folder under its name; exit code and what it said."""
    words = list(map(str, arguments))
    with spent_on("campaigns"), signal_handlers_kept(), chdir(folder):
        done = CliRunner().invoke(command, words, prog_name=name)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return subprocess.CompletedProcess(words, done.exit_code, done.stdout, done.stderr)
