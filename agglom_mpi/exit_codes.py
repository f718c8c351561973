"""What `agglom-invert` and `agglom` end with."""

from typing import Final

FINISHED: Final = 0
FAILURE: Final = 1
BAD_INPUT: Final = 2
STOPPED: Final = 75
"""Stopped early; running the same command again goes on."""
INTERRUPTED: Final = 130
"""Ctrl-C ended what only looks on."""
