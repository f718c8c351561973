"""Runs of `agglom-invert` on a disc that fills up at a chosen call, each in a fork of one process.

The disc is `faulty_disc.c`. Imports and kernels are loaded once, so that a run takes a moment.
"""

import ctypes
import errno
import json
import os
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest
from campaign_runs import environment, finish
from processes import HANG, program

from agglom_mpi.cli.common import launch
from agglom_mpi.cli.invert import invert_command

SOURCE = Path(__file__).with_name("faulty_disc.c")
FOREVER = 10**9


class Faulty(NamedTuple):
    """How a run on such a disc ended; its exit code, outputs, and the number of calls it made."""

    code: int
    said: str
    errors: str
    calls: int


def compiled(folder):
    """Return the disc as a library; skip without a compiler, which the integration must have."""
    if shutil.which("gcc") is None:
        assert "CI" not in os.environ, "no gcc to compile the disc that fails"
        pytest.skip("the disc that fails is compiled by gcc")
    library = folder / "faulty_disc.so"
    words = ["gcc", "-shared", "-fPIC", "-O1", "-o", library, SOURCE, "-ldl"]
    subprocess.run(words, check=True, timeout=HANG)
    return library


@contextmanager
def faulty_runs(library, campaign):
    """Yield a function that runs `agglom-invert` in a folder, with calls that fail.

    Its arguments are the folder, the numbers of the first and the last call that fails, the words
    of the command, and the error number. The kernels that it needs are those of `campaign`.
    """
    env = environment(Path(__file__).parents[1] / "helpers", LD_PRELOAD=str(library))
    command = [sys.executable, __file__, campaign.parent, campaign.name]
    with program(command, env=env, stdin=subprocess.PIPE) as server:

        def run(folder, first, last, *arguments, error=errno.ENOSPC):
            calls = [first, last, error]
            job = {"folder": str(folder), "calls": calls, "arguments": arguments}
            server.stdin.write(json.dumps(job) + "\n")
            server.stdin.flush()
            code = server.stdout.readline()
            assert code, server.stderr.read()
            said, errors, calls = (Path(f"{folder}.{end}") for end in ("out", "err", "calls"))
            return Faulty(int(code), said.read_text(), errors.read_text(), int(calls.read_text()))

        yield run
        server.stdin.close()


def _serve():
    """Run what standard input asks for, one line each, and print the exit codes."""
    from agglom_mpi.runtime import simulation_thread
    from agglom_mpi.storage import row_buffer

    # Every sample is written by itself, at once.
    row_buffer.FLUSH_AGE = simulation_thread.MAX_DELAY = 0.0
    finish(Path(sys.argv[1]), sys.argv[2], "--output", f"{os.getpid()}.h5")
    for line in sys.stdin:
        child = os.fork()
        if not child:
            _run(**json.loads(line))
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


def _run(folder, calls, arguments):
    for descriptor, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(f"{folder}.{name}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), descriptor)
    os.chdir(folder)
    sys.argv[1:] = arguments
    disc = ctypes.CDLL(None)
    disc.fail_calls(folder.encode(), *map(ctypes.c_long, calls))
    try:
        launch(invert_command, simulates=True)
    finally:
        Path(f"{folder}.calls").write_text(str(disc.count_calls()))


if __name__ == "__main__":
    _serve()
