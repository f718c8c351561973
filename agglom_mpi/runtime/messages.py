"""Messages between ranks: fixed-size typed records, never pickles; what is new in them."""

import socket
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.outcome import FailureReason
from agglom_mpi.runtime.abort_flag import SampleUnderWay
from agglom_mpi.scheduling.interface import ReturnedPart
from agglom_mpi.scheduling.scheduler import Scheduler
from agglom_mpi.scheduling.static_scheduler import StaticScheduler
from agglom_mpi.storage.schema import final_particles_schema, frames_schema, sample_dtype
from agglom_mpi.storage.table import concatenated


class PendingSends:
    """Requests of messages that MPI still sends, each with its buffer, which MPI reads meanwhile.

    Whoever waited for one would hear nothing while the receiver is held up.
    """

    def __init__(self) -> None:
        self._sends: list[tuple[Any, NDArray[Any]]] = []

    def __len__(self) -> int:
        return len(self._sends)

    def add(self, request: Any, records: NDArray[Any]) -> None:
        """Add a message by the request that MPI returned for it."""
        self._sends.append((request, records))

    def forget_sent(self) -> None:
        """Let go of what has been sent."""
        if self._sends:
            self._sends = [(sent, kept) for sent, kept in self._sends if not sent.Test()]

    def wait(self) -> None:
        """Wait until everything has been sent."""
        for request, _ in self._sends:
            request.Wait()
        self._sends.clear()


TASKS: Final = 1  # to a worker: tasks to simulate, of `scheduling.interface.task_type`
RESULTS: Final = 2  # from a worker: parts of its tasks and their rows, of `packed_results`
FAILURE: Final = 3  # from a worker: the traceback of a sample, `FAILED_SAMPLE`
STOP: Final = 4  # to a worker: its exit code, int32; from a worker: `GOODBYE`
WRITTEN: Final = 5  # from a worker: number of samples that it has written since the last, int64
UNWRITTEN: Final = 6  # from a worker: why it cannot write the campaign file, `FAILED_SAMPLE`
SYNC: Final = 7  # to a worker: write everything to the disc
FINALS: Final = 8  # from a worker: rows of `/final_particles`
FRAMES: Final = 9  # from a worker: one row of `/frames`
ALIVE: Final = 10  # both ways: `HEARTBEAT`
CANCEL: Final = 11  # to a worker: strings that need no more samples, int64
PROGRAM: Final = 12  # from a worker, first of all: its program, as in `launch.py`
"""Message tags."""

RESULT: Final = sample_dtype
"""Record of a simulated sample whose objective has no quantities, a row of `/samples`."""

PART: Final = np.dtype(
    [
        *(("string", "i8"), ("first", "i8"), ("size", "i8"), ("left_out", "i8")),
        *(("seconds", "f8"), ("cpu_seconds", "f8")),
    ]
)
"""What a rank has done of a task: its samples from `first` on, whether it leaves out all others,
and the time in s of one that was begun and not needed any more."""

FAILED_SAMPLE: Final = np.dtype(
    [
        ("string", "i8"),
        ("sample", "i8"),
        ("frames", "i8"),
        ("rank", "i4"),
        ("host", "S64"),
        ("text", "S1000"),
    ]
)
"""The traceback of a sample that raised, `frames` as in its task."""

HEARTBEAT: Final = np.dtype(
    [
        ("host", "S64"),
        ("wakeup", "S64"),
        ("string", "i8"),
        ("sample", "i8"),
        ("seconds", "f8"),
        ("writes", "?"),
        ("alone", "?"),
    ]
)
"""The host of a rank, and the name that it is woken by; the sample under way, string -1 if there is
none, and its time so far in s; whether the rank is about to write to the campaign file, and
whether its launcher is gone. Rank 0 answers with its own to those that it can wake, and to all
where it has nothing else to send."""

GOODBYE: Final = np.dtype([("database_seconds", "f8")])
"""Last message of a rank that has stopped: time that it spent on the campaign file, in s."""

NO_RESULTS: Final = np.zeros(0, RESULT)
NO_PARTS: Final = np.zeros(0, PART)
NO_FAILURES: Final = np.zeros(0, FAILED_SAMPLE)


class RankMessage(NamedTuple):
    """Report of a rank; a heartbeat if it has no content.

    The simulating thread of a rank makes one message of all that it has finished; another rank
    sends several, one for each record type.
    """

    rank: int
    results: NDArray[np.void] = NO_RESULTS
    """Rows of `/samples` in execution order, (n,)."""
    parts: NDArray[np.void] = NO_PARTS
    """The parts of tasks that they are, one after the other, of `PART`, (m,)."""
    failures: NDArray[np.void] = NO_FAILURES
    """Records of `FAILED_SAMPLE`, (n,)."""
    final_particles: NDArray[np.void] | None = None
    """Rows of `/final_particles`, (n,); None if there are none."""
    frames: tuple[NDArray[np.void], ...] = ()
    """Consecutive rows of `/frames` of one sample each, (n,)."""
    written: int = 0
    """Number of samples that the rank has written itself since its last such report."""
    stopped: bool = False
    """Whether this is the last message of the rank."""
    database_seconds: float = 0.0
    """Time that a rank which has stopped spent on the campaign file, in s."""
    under_way: SampleUnderWay | None = None
    """The sample that the rank simulates, if this is a heartbeat."""
    writes: bool = False
    """Whether the rank is about to write to the campaign file, and may be silent for long."""

    @property
    def empty(self) -> bool:
        """Whether the message reports nothing that was simulated or left out."""
        return (
            not (len(self.parts) or len(self.failures) or self.frames)
            and self.final_particles is None
        )

    def records(self) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield the messages, each a tag and records, (n,), that report samples to rank 0.

        Final particles come before the results that they belong to, and each frame alone, as it
        may be large.
        """
        if self.final_particles is not None:
            yield FINALS, self.final_particles
        if len(self.failures):
            yield FAILURE, self.failures
        for rows in self.frames:
            for frame in rows.reshape(-1, 1):
                yield FRAMES, frame
        if len(self.parts):
            yield RESULTS, packed_results(self.parts, self.results)


def merged(rank: int, messages: Sequence[RankMessage]) -> RankMessage:
    """Return one message with the samples of several messages of the same rank, in order."""
    final = [each.final_particles for each in messages if each.final_particles is not None]
    results = [each.results for each in messages if len(each.results)]
    return RankMessage(
        rank,
        concatenated(results, results[0].dtype if results else RESULT),
        concatenated([each.parts for each in messages if len(each.parts)], PART),
        concatenated([each.failures for each in messages if len(each.failures)], FAILED_SAMPLE),
        concatenated(final, final[0].dtype) if final else None,
        tuple(rows for each in messages for rows in each.frames),
    )


def packed_results(parts: NDArray[np.void], rows: NDArray[np.void]) -> NDArray[np.uint8]:
    """Return the bytes of parts of tasks, of `PART`, (m,), and of their rows, (n,)."""
    counts = np.array([len(parts)])
    whole = b"".join((counts.tobytes(), parts.tobytes(), rows.tobytes()))
    return np.frombuffer(whole, np.uint8)


def record_types(grains: int, spins: bool = False) -> dict[int, np.dtype]:
    """Return the types of records that rank 0 receives, by tag.

    `grains` is the largest number of particles of a sample; with `spins`, they spin.
    """
    return {
        RESULTS: np.dtype(np.uint8),
        FAILURE: FAILED_SAMPLE,
        UNWRITTEN: FAILED_SAMPLE,
        WRITTEN: np.dtype(np.int64),
        ALIVE: HEARTBEAT,
        STOP: GOODBYE,
        FINALS: final_particles_schema(grains, spins).dtype,
        FRAMES: frames_schema(grains, spins).dtype,
    }


def decoded(rank: int, tag: int, records: NDArray[Any], result: np.dtype = RESULT) -> RankMessage:
    """Return the message of a rank whose records, (n,), came under a tag.

    `result` is the type of its rows of `/samples`.

    Raises
    ------
    OSError
        If it reports that it cannot write the campaign file.
    """
    if tag == RESULTS:
        begin = np.dtype(np.int64).itemsize
        end = begin + int(records[:begin].view(np.int64)[0]) * PART.itemsize
        return RankMessage(rank, records[end:].view(result), records[begin:end].view(PART))
    if tag == FAILURE:
        return RankMessage(rank, failures=records)
    if tag == FINALS:
        return RankMessage(rank, final_particles=records)
    if tag == FRAMES:
        return RankMessage(rank, frames=(records,))
    if tag == WRITTEN:
        return RankMessage(rank, written=int(records[0]))
    if tag == STOP:
        seconds = float(records["database_seconds"][0])
        return RankMessage(rank, stopped=True, database_seconds=seconds)
    if tag == UNWRITTEN:
        host, text = (records[name][0].decode() for name in ("host", "text"))
        raise OSError(f"rank {rank} on {host}: {text}")
    if tag == ALIVE and records["string"][0] >= 0:
        string, sample, seconds = records[["string", "sample", "seconds"]][0].tolist()
        return RankMessage(rank, under_way=SampleUnderWay(string, sample, seconds))
    return RankMessage(rank, writes=tag == ALIVE and bool(records["writes"][0]))


def heartbeat(
    wakeup: bytes,
    under_way: SampleUnderWay | None = None,
    *,
    writes: bool = False,
    alone: bool = False,
) -> NDArray[np.void]:
    """Return the `HEARTBEAT` record, shape (1,), of this rank."""
    sample = (-1, -1, 0.0) if under_way is None else under_way
    return np.array([(own_host(), wakeup, *sample, writes, alone)], HEARTBEAT)


def failed_sample(
    string: int, sample: int, rank: int, text: str, frames: int = 0
) -> NDArray[np.void]:
    """Return the `FAILED_SAMPLE` record, shape (1,), of an exception.

    Of a long text it has the first line, as of a traceback, and the last ones.
    """
    record = np.zeros(1, FAILED_SAMPLE)
    record["string"], record["sample"], record["rank"] = string, sample, rank
    record["frames"] = frames
    record["host"] = own_host()
    # What is no text, as half of a surrogate pair, is written as Python writes it.
    encoded, room = text.encode(errors="backslashreplace"), FAILED_SAMPLE["text"].itemsize
    if len(encoded) > room:
        first = encoded.partition(b"\n")[0]
        head = first + _LEFT_OUT if len(first) <= _FIRST_LINE else b""
        encoded = head + encoded[len(head) - room :].decode(errors="ignore").encode()
    record["text"] = encoded
    return record


_LEFT_OUT: Final = b"\n  ...\n"
"""End of the first line of a text, and a line in place of those that it has no room for."""

_FIRST_LINE: Final = 100
"""Maximum length of a first line, such as that of a traceback, that a shortened text has."""


def own_host() -> bytes:
    """Return the name of this host as records have it."""
    return socket.gethostname().encode(errors="backslashreplace")[:64]


def storable(results: NDArray[np.void]) -> NDArray[np.void]:
    """Return the results that are stored: a sample that took too long may be tried again."""
    if FailureReason.TIMED_OUT not in results["reason"].tobytes():
        return results
    return results[results["reason"] != FailureReason.TIMED_OUT]


class RankPart(NamedTuple):
    """A part of a task of a rank, and where its rows begin among those of all parts."""

    rank: int
    part: ReturnedPart
    begin: int


def rank_parts(messages: Sequence[RankMessage]) -> list[RankPart]:
    """Return the parts of tasks that messages report, in order, as their rows lie together."""
    found, begin = [], 0
    for message in messages:
        columns = (message.parts[name].tolist() for name in ReturnedPart._fields)
        for string, first, size, left_out in zip(*columns, strict=True):
            part = ReturnedPart(string, first, size, bool(left_out))
            found.append(RankPart(message.rank, part, begin))
            begin += size
    return found


def first_returns(
    scheduler: Scheduler | StaticScheduler, returned: Sequence[RankPart], rows: NDArray[np.void]
) -> tuple[dict[int, bool], list[tuple[int, int, int, int]], NDArray[np.void]]:
    """Take samples off those in flight, and return what is new among them.

    `rows` are the rows of `/samples` of these parts and perhaps others, (n,).

    Returns
    -------
    tuple
        The strings of all parts, and whether ranks left out samples of each; the new rows as parts
        of one string: string, first sample, begin and end; and all new rows.

    Raises
    ------
    RuntimeError
        If a rank sent something else than what it was to do next.
    """
    strings: dict[int, bool] = {}
    parts, kept, end = [], [], 0
    for rank, part, begin in returned:
        for new in scheduler.returned(rank, part):
            size = new.stop - new.start
            parts.append((part.string, part.first + new.start, end, end + size))
            kept.append((begin + new.start, begin + new.stop))
            end += size
        strings[part.string] = strings.get(part.string, False) or part.left_out
    if end != len(rows):
        rows = concatenated([rows[begin:end] for begin, end in kept], rows.dtype)
    scheduler.batch_sizer.learn(rows["seconds"].tolist())
    return strings, parts, rows
