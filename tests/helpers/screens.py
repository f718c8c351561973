"""Terminals to look at: pseudo-terminals whose other end draws what a terminal would show."""

import fcntl
import os
import pty
import re
import select
import struct
import sys
import termios
from contextlib import contextmanager

import pyte
from processes import program, wait_for

from agglom_mpi.display.terminal import CUT


class Screen:
    """A terminal of so many columns and rows; what programs write to `name` is on `lines`."""

    def __init__(self, columns, rows=24):
        self.master, self.slave = pty.openpty()
        self.name = os.ttyname(self.slave)
        self._size = columns, rows
        self._screen = pyte.Screen(columns, rows)
        self._stream = pyte.ByteStream(self._screen)
        self.raw = b""
        self.resize(columns, rows)

    def resize(self, columns, rows=24):
        """Cut lines that are too long, as xterm does."""
        self._screen.resize(rows, columns)
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def take(self, patience=0.0):
        """Take what has been written by now, without drawing it.

        If there is nothing yet, something may come within `patience` seconds.
        """
        taken = b""
        while select.select([self.master], [], [], 0.0 if taken else patience)[0]:
            taken += os.read(self.master, 65536)
        self.raw += taken
        return taken

    def read(self):
        """Draw what has been written by now."""
        self._stream.feed(self.take())
        return self.lines

    @property
    def lines(self):
        """What is shown, without the empty lines at the end."""
        return lines_of(self._screen)

    def drawn(self):
        """Return what was shown, one after the other, each time before it was drawn anew."""
        again = pyte.Screen(*self._size)
        stream, seen = pyte.ByteStream(again), []
        for piece in re.split(f"(?={re.escape(CUT)})".encode(), self.raw):
            stream.feed(piece)
            seen.append(lines_of(again))
        return seen

    @property
    def cursor(self):
        """Column and row, from 0."""
        return self._screen.cursor.x, self._screen.cursor.y

    def close(self):
        os.close(self.master)
        os.close(self.slave)


def lines_of(drawn):
    """Lines of a screen, without the empty ones at the end."""
    return "\n".join(line.rstrip() for line in drawn.display).rstrip().split("\n")


@contextmanager
def screen(columns, rows=24):
    """Open a terminal for a block."""
    opened = Screen(columns, rows)
    try:
        yield opened
    finally:
        opened.close()


def started_on(opened, command, folder, environment):
    """Start a program in the foreground of a terminal of its own session, for a block."""
    login = "import fcntl,os,sys,termios; fcntl.ioctl(0,termios.TIOCSCTTY,0); "
    login += "os.execvp(sys.argv[1],sys.argv[1:])"
    ends = dict.fromkeys(("stdin", "stdout", "stderr"), opened.slave)
    return program([sys.executable, "-c", login, *command], cwd=folder, env=environment, **ends)


def watched(opened, process):
    """Watch until the program ends; all that was shown."""
    wait_for(lambda: opened.take(0.1) is not None and process.poll() is not None, "end")
    opened.take()
    return opened.drawn()
