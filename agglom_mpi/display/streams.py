"""Standard streams that take any text, and outlive the terminal or the pipe that reads them."""

import errno
import io
import os
import sys
from typing import Any, Final, TextIO

from agglom_mpi.errors import BROKEN_PIPE
from agglom_mpi.formatting import ASCII_REPLACEMENT

_LOST: Final = (errno.EPIPE, errno.EIO, errno.EBADF)
"""Error numbers of a write without a reader: a closed pipe, a lost terminal, a closed file."""


class StandardOutput(io.FileIO):
    """Standard output or error whose reader may go away.

    Parameters
    ----------
    descriptor
        1 or 2; it is not closed with this file.
    endures
        Whether the program goes on without it, as without room for it on a disk; else it ends
        quietly, with `BROKEN_PIPE`.
    """

    def __init__(self, descriptor: int, endures: bool) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self._endures = endures

    def write(self, data: Any) -> int:
        """Write bytes; return how many were written, or given up.

        Raises
        ------
        OSError
            For example if the disk is full, unless the program endures it.
        SystemExit
            If nobody reads, unless the program endures it.
        """
        try:
            return super().write(data) or 0
        except OSError as error:
            if error.errno in _LOST:
                self.discard()
                if not self._endures:
                    sys.exit(BROKEN_PIPE)
            elif not self._endures:
                name = "standard output" if self.fileno() == 1 else "standard error"
                raise OSError(error.errno, error.strerror, name) from error
            return memoryview(data).nbytes

    def discard(self) -> None:
        """Let all further output, also that of other libraries, go to the null device."""
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, self.fileno())
        os.close(null)


def prepare_streams(endures: bool) -> None:
    """Make standard output and error accept any text, and settle what follows if they are lost.

    A stream that was closed when the program started becomes the null device: else the next file
    to be opened would get its number, and what libraries print would be written into that file.

    Parameters
    ----------
    endures
        Whether the program goes on when nobody reads its output any more.
    """
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it gets the lowest number that is free, this one
    sys.stdout = _prepared(sys.stdout, sys.__stdout__, 1, endures)
    sys.stderr = _prepared(sys.stderr, sys.__stderr__, 2, endures)


def _prepared(
    stream: TextIO | None, original: TextIO | None, descriptor: int, endures: bool
) -> TextIO:
    if stream is not original and stream is not None:  # a caller has replaced it
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=ASCII_REPLACEMENT)
        return stream
    output = StandardOutput(descriptor, endures)
    if not isinstance(stream, io.TextIOWrapper):  # it was closed
        return io.TextIOWrapper(io.BufferedWriter(output), "utf-8", ASCII_REPLACEMENT)
    stream.flush()
    unbuffered = stream.write_through  # as `python -u` asks for
    return io.TextIOWrapper(
        output if unbuffered else io.BufferedWriter(output),
        stream.encoding,
        ASCII_REPLACEMENT,
        line_buffering=stream.line_buffering,
        write_through=unbuffered,
    )


def flush_streams() -> None:
    """Write what is still buffered, as the end of a process does, but with its errors raised.

    Raises
    ------
    OSError
        If it cannot be written; the rest is discarded.
    SystemExit
        If nobody reads it, unless the program endures it.
    """
    for stream in (sys.stdout, sys.stderr):
        if stream is None:
            continue
        try:
            stream.flush()
        except OSError:
            raw = getattr(getattr(stream, "buffer", None), "raw", None)
            if isinstance(raw, StandardOutput):
                raw.discard()
            raise
