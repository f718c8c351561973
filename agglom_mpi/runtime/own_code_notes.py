"""Samples under way in code of the user's that may end its process: noted, and tried again alone.

A crash of such code leaves no exception. So each rank notes a sample in the lock file of the
campaign before it calls the code. A start tries what an earlier one has left there without a
result in a process of its own, and records it as failed if that process ends as well. What somebody
else has killed passes, and is simulated as if nothing had happened.
"""

import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import cycle
from pathlib import Path
from struct import pack
from typing import Final

import numpy as np

from agglom_mpi.config.own_components import permitted_modules
from agglom_mpi.launcher import python_command, without_rank_variables
from agglom_mpi.outcome import FAILED, FailureReason
from agglom_mpi.runtime.experiment import Experiment
from agglom_mpi.runtime.messages import own_host
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.scheduling.interface import volume_string
from agglom_mpi.storage.lock import NOTES_OFFSET, CampaignLock
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.schema import samples_schema
from agglom_mpi.storage.table import checksums
from agglom_mpi.storage.writer import CampaignWriter
from agglom_mpi.verbs.simulate import simulate

NOTE: Final = np.dtype([("string", "i8"), ("first", "i8"), ("count", "i8")])
"""Consecutive samples of a string that were begun on a rank; none with a count of 0."""
MAX_TRIAL: Final = 120
"""Maximum time of all trials at a start in s; what is not tried by then is simulated as usual."""
TRIAL: Final = "from agglom_mpi.runtime.own_code_notes import try_samples; try_samples()"
"""Program of the process of a trial."""


class OwnCodeNotes:
    """Notes of a rank in the lock file, which is there: rank 0 holds it.

    The last two stay: a process that is sent a signal by its own code runs on for a moment.

    Parameters
    ----------
    path
        The campaign file.
    rank
        Number of the rank.
    """

    def __init__(self, path: Path, rank: int) -> None:
        self._places = cycle(NOTES_OFFSET + (2 * rank + i) * NOTE.itemsize for i in range(2))
        self._descriptor = -1  # where the file is not seen, as on another host, nothing is noted
        with suppress(OSError):
            self._descriptor = os.open(CampaignLock(path).lock_path, os.O_RDWR | os.O_NOFOLLOW)

    def begin(self, string: int, first: int, count: int) -> None:
        """Note consecutive samples of a string before they are simulated."""
        with suppress(OSError):
            os.pwrite(self._descriptor, pack("3q", string, first, count), next(self._places))


def notes_left(path: Path) -> list[tuple[int, int]]:
    """Return string and number of the samples that are noted in the lock file of a campaign file.

    The next holder of the lock removes them.
    """
    content = b""
    with suppress(OSError):
        content = CampaignLock(path).lock_path.read_bytes()[NOTES_OFFSET:]
    rows = np.frombuffer(content[: len(content) // NOTE.itemsize * NOTE.itemsize], NOTE).tolist()
    return sorted({(string, first + i) for string, first, count in rows for i in range(count)})


def ended_samples(
    experiment: Experiment,
    file: CampaignData,
    noted: list[tuple[int, int]],
    stop: StopRequest,
) -> Iterator[tuple[int, int, str]]:
    """Yield string and number of noted samples that end a process of their own, and how.

    Samples that are in the file are not tried.
    """
    names = ", ".join(sorted(name for name, _ in permitted_modules(experiment.campaign)))
    if not (names and noted):
        return
    known = set(map(tuple, file.all_sample_rows()[["string", "sample"]].tolist()))
    known |= set(map(tuple, file.fresh_keys.tolist()))
    left = [
        (experiment.setup(string), file.parameters[own.string], string, sample)
        for string, sample in noted
        if (string, sample) not in known
        and (own := volume_string(string)).string in file.parameters
    ]
    end = time.monotonic() + MAX_TRIAL
    while left and not stop.reason and (seconds := int(end - time.monotonic())) > 0:
        tried, code = _tried(pickle.dumps((seconds, left)), stop)
        if not tried or code in (None, 0, -signal.SIGALRM):
            return
        how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        *_, string, sample = left[tried - 1]
        text = f"code of {names} ended its process, and once more when it was alone, with {how}"
        yield string, sample, text
        left = left[tried:]


def _tried(work: bytes, stop: StopRequest) -> tuple[int, int | None]:
    """Return how many samples a process began, and its exit code; None if it was stopped."""
    process = subprocess.Popen(
        python_command(TRIAL),
        env=without_rank_variables(os.environ),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # an interrupt is for this process
    )
    assert process.stdin is not None
    assert process.stdout is not None
    with process, suppress(BrokenPipeError):
        process.stdin.write(work)
        process.stdin.close()
        while (code := process.poll()) is None and not stop.reason:
            time.sleep(0.05)
        if code is None:
            process.kill()
        return len(process.stdout.read()), code
    return 0, None


def try_samples() -> None:
    """Simulate the samples on standard input; write a byte before each to standard output."""
    seconds, samples = pickle.load(sys.stdin.buffer)
    answers = os.dup(1)
    os.dup2(2, 1)  # for what the code prints
    signal.alarm(seconds)
    for setup, parameters, _, sample in samples:
        os.write(answers, b".")
        with suppress(Exception):
            simulate(setup.campaign, parameters, setup.first_sample + sample, setup.engine)


def record_ended(
    experiment: Experiment,
    file: CampaignData,
    writer: CampaignWriter,
    noted: list[tuple[int, int]],
    stop: StopRequest,
) -> Iterator[str]:
    """Record as failed the noted samples that end a process of their own; yield a line on each."""
    sizes = experiment.table_sizes
    for string, sample, text in ended_samples(experiment, file, noted, stop):
        row = np.zeros(1, samples_schema(dict(sizes.quantities), sizes.census).dtype)
        row["string"], row["sample"], row["finished"] = string, sample, time.time()
        row["state"], row["reason"] = FAILED, FailureReason.EXCEPTION
        row["crc"] = checksums(row)
        writer.put_samples(row)
        writer.flush()
        writer.log.put_failure(string, sample, rank=0, host=own_host().decode(), text=text)
        file.refresh()
        yield f"string {volume_string(string).text} sample {sample} failed: {text}"
