"""What a report needs before anything is simulated or written: libraries and a directory."""

import importlib.util
from pathlib import Path


class ExportError(ValueError):
    """A report or an export that cannot be made, with the reason in one line."""


class MissingLibraryError(ExportError, ImportError):
    """An optional library that is not installed, with the command that installs it."""


def require_library(name: str, purpose: str) -> None:
    """Check that an optional library is installed, without importing it.

    Parameters
    ----------
    name
        Name by which it is imported.
    purpose
        What needs it, in the plural: `figures`.

    Raises
    ------
    MissingLibraryError
        If it is not installed.
    """
    if importlib.util.find_spec(name) is None:
        raise MissingLibraryError(f"{purpose} need {name}: pip install 'agglom_mpi[report]'")


def require_directory(path: Path) -> None:
    """Check that a path is a directory or absent.

    Raises
    ------
    ExportError
        If something else has this name.
    """
    if path.exists() and not path.is_dir():
        raise ExportError(f"{path}: is no directory")
