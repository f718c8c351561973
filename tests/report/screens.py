"""Terminals to look at: pseudo-terminals whose other end draws what a terminal would show."""

import fcntl
import os
import pty
import select
import struct
import subprocess
import sys
import termios
import time
from contextlib import contextmanager

import pyte


class Screen:
    """A terminal of so many columns and rows; what programs write to `name` is on `lines`."""

    def __init__(self, columns, rows=24):
        self.master, self.slave = pty.openpty()
        self.name = os.ttyname(self.slave)
        self._screen = pyte.Screen(columns, rows)
        self._stream = pyte.ByteStream(self._screen)
        self.raw = b""
        self.resize(columns, rows)

    def resize(self, columns, rows=24):
        """Cut lines that are too long, as xterm does."""
        self._screen.resize(rows, columns)
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def read(self, seconds=0.0):
        """Draw what has been written by now, or is within so many seconds."""
        end = time.monotonic() + seconds
        while select.select([self.master], [], [], max(0.0, end - time.monotonic()))[0]:
            data = os.read(self.master, 65536)
            self.raw += data
            self._stream.feed(data)
        return self.lines

    @property
    def lines(self):
        """What is shown, without the empty lines at the end."""
        return "\n".join(line.rstrip() for line in self._screen.display).rstrip().split("\n")

    @property
    def cursor(self):
        """Column and row, from 0."""
        return self._screen.cursor.x, self._screen.cursor.y

    def close(self):
        os.close(self.master)
        os.close(self.slave)


@contextmanager
def screen(columns, rows=24):
    """Open a terminal for a block."""
    opened = Screen(columns, rows)
    try:
        yield opened
    finally:
        opened.close()


def started_on(opened, command, folder, environment):
    """Start a program in the foreground of a terminal of its own session."""
    login = "import fcntl,os,sys,termios; fcntl.ioctl(0,termios.TIOCSCTTY,0); "
    login += "os.execvp(sys.argv[1],sys.argv[1:])"
    return subprocess.Popen(
        [sys.executable, "-c", login, *command],
        cwd=folder,
        env=environment,
        stdin=opened.slave,
        stdout=opened.slave,
        stderr=opened.slave,
        start_new_session=True,
    )


def watched(opened, process, seconds=120.0):
    """Watch until the program ends; the different screens that were seen."""
    seen, end = [], time.monotonic() + seconds
    while process.poll() is None:
        lines = opened.read(0.05)
        if not seen or seen[-1] != lines:
            seen.append(lines)
        assert time.monotonic() < end, lines
    seen.append(opened.read(0.2))
    return seen
