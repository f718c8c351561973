"""A few lines at the end of a terminal that are drawn again and again.

The cursor waits at the beginning of the first of them, so that nothing needs to be known of what
is on the screen: whatever became of the lines, by a resize or by what others wrote, they are
overwritten from there, and what follows is erased. It is never hidden: a run that is killed leaves
a terminal as it was. Two empty lines come first, for what shells and launchers say of a Ctrl-C.
"""

from typing import Final

from rich.console import Console, RenderableType
from rich.text import Text

from agglom_mpi.report.progress import Progress, lines
from agglom_mpi.report.terminal import Terminal

ERASE_LINE: Final = "\x1b[K"
ERASE_BELOW: Final = "\x1b[J"
CUT: Final = "\x1b[?7l"
"""What is too long for a line is lost: the terminal may be narrower by now than it just said."""
WRAP: Final = "\x1b[?7h"
EMPTY: Final = (Text(), Text())


class Live:
    """Lines of a `Progress` on a terminal, and messages above them."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._shown: Progress | None = None
        self._console = Console(
            file=terminal.stream,
            force_terminal=True,
            legacy_windows=False,
            highlight=False,
            markup=False,
            emoji=False,
        )

    def show(self, progress: Progress) -> None:
        """Draw, unless somebody else has the terminal now."""
        self._shown = progress
        if self._terminal.in_foreground():
            self._write(self._drawn(progress))

    def say(self, content: RenderableType, style: str | None = None) -> None:
        """Print something that stays, above the lines."""
        self._console.width = self._terminal.columns
        with self._console.capture() as capture:
            self._console.print(content, style=style)
        again = ""
        if self._shown is not None and self._terminal.in_foreground():
            again = self._drawn(self._shown)
        self._write(f"\r{ERASE_BELOW}{capture.get()}{again}")

    def stop(self) -> None:
        """Erase the lines."""
        if self._shown is not None and self._terminal.in_foreground():
            self._write(f"\r{ERASE_BELOW}")
        self._shown = None

    def _drawn(self, progress: Progress) -> str:
        columns, rows = self._terminal.size
        encoding = self._terminal.stream.encoding or "utf-8"
        found = [*EMPTY, *lines(progress, columns, encoding)][: max(1, rows - 1)]
        drawn = f"{ERASE_LINE}\r\n".join(map(self._styled, found))
        up = f"\x1b[{len(found) - 1}A" if len(found) > 1 else ""
        return f"{CUT}\r{drawn}{ERASE_BELOW}{WRAP}\r{up}"

    def _styled(self, line: Text) -> str:
        system = self._console._color_system
        return "".join(
            segment.style.render(segment.text, color_system=system)
            if segment.style
            else segment.text
            for segment in line.render(self._console)
        )

    def _write(self, text: str) -> None:
        try:
            self._terminal.stream.write(text)
            self._terminal.stream.flush()
        except (OSError, ValueError):  # the terminal was closed; the run goes on
            self._shown = None
