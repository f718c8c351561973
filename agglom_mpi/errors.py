"""Errors that the user can mend, exit codes, and the check for optional libraries."""

import importlib.util
from typing import ClassVar, Final

from agglom_mpi.formatting import printable

FINISHED: Final = 0
FAILURE: Final = 1
"""Anything else than the others: an unexpected error, a damaged file, samples that all failed."""
BAD_INPUT: Final = 2
STOPPED: Final = 75
"""Stopped early; running the same command again continues it."""
INTERRUPTED: Final = 130
"""Ctrl-C ended a command that only reads."""
BROKEN_PIPE: Final = 141
"""Nobody reads the output of a command that only reads, as a shell shows it of SIGPIPE."""


class UserError(Exception):
    """An error that the user can mend; its text is all that is shown, without a traceback.

    Attributes
    ----------
    exit_code : int
        What the command ends with.
    """

    exit_code: ClassVar[int] = BAD_INPUT


class CodeNotAllowedError(UserError):
    """Something needs code of the user's, which may not run."""


class MissingLibraryError(UserError, ImportError):
    """An optional library is not installed."""


def require_library(name: str, extra: str, purpose: str) -> None:
    """Raise a MissingLibraryError unless an optional library is installed; import nothing.

    Parameters
    ----------
    name
        The library's name as it is imported.
    extra
        The extra of this package that installs it.
    purpose
        What needs it, a plural that begins the message: `figures`.
    """
    if importlib.util.find_spec(name) is None:
        raise MissingLibraryError(f"{purpose} need {name}: pip install 'agglom_mpi[{extra}]'")


def error_text(error: Exception) -> str:
    """Return an error as one message; the operating system's as `FILE: REASON` or `REASON`."""
    if isinstance(error, OSError) and error.strerror:
        return printable(
            f"{error.filename}: {error.strerror}" if error.filename else error.strerror
        )
    return printable(str(error))


def named_error(error: BaseException) -> str:
    """Return an error as `TYPE: TEXT`; of a user's class that has no readable text, its type."""
    try:
        return f"{type(error).__name__}: {error}"
    except BaseException:
        return type(error).__name__


_EXHAUSTED: Final = {
    "can't start new thread": "no more threads are allowed here (ulimit -u)",
    "failed to map segment": "not enough memory is allowed here (ulimit -v)",
}


def exhausted(error: BaseException) -> str:
    """Return what the machine or a limit of it has too little of; empty for other errors."""
    if isinstance(error, MemoryError):
        return "not enough memory is free, or allowed here (ulimit -v)"
    if isinstance(error, RuntimeError | ImportError):
        return next((text for sign, text in _EXHAUSTED.items() if sign in str(error)), "")
    return ""
