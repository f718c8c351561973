"""The console that all tables and messages are printed with."""

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from agglom_mpi.formatting import printable


class PlainConsole(Console):
    """Console that shows texts as they are written.

    Titles, names and paths are the user's: [brackets] and :colons: in them are plain text, and
    control characters do not reach the terminal.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Yield the segments of something; of texts, but not of styles, made printable."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=printable(segment.text))
