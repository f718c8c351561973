"""Code of the user's, run so that nothing but exceptions come out of it."""

import linecache
import os
import posix
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from types import ModuleType
from typing import Any, Final

from agglom_mpi.errors import FAILURE


class EndedError(RuntimeError):
    """A user's code has asked to end the process, or to replace it by another program."""


@contextmanager
def users_code(name: str) -> Iterator[None]:
    """Let nothing but exceptions come out of code of the user's; `name` is for messages.

    What would end the rank, and with it perhaps the run with exit code 0, raises an EndedError. A
    process that the code has forked ends here if it gets here, as it is no rank.

    Raises
    ------
    EndedError
        Instead of SystemExit and whatever else is no Exception. A Ctrl-C stays one: it reaches the
        main thread alone.
    """
    _refuse_endings()
    owner, outer = os.getpid(), getattr(_INSIDE, "owner", None)
    _INSIDE.owner = owner
    try:
        here = os.getcwd()
    except OSError:  # it was removed
        here = ""
    try:
        yield
    except Exception:
        raise
    except BaseException as error:
        main = threading.current_thread() is threading.main_thread()
        if main and isinstance(error, KeyboardInterrupt):
            raise
        raise EndedError(f"{name} raised {type(error).__name__}, which would end a rank") from error
    finally:
        if here:
            os.chdir(here)  # names of files that the user gave are relative to it
        _INSIDE.owner = outer
        if os.getpid() != owner:
            _ENDINGS["_exit"](FAILURE)


def execute(file: str, source: bytes, module: ModuleType) -> None:
    """Execute the source of a user's module of Python.

    Parameters
    ----------
    file, source
        Name of the file, for tracebacks, and its bytes.
    module
        Empty module, which receives what the source defines. While it can be used it is in
        `sys.modules`, where classes look their module up.

    Raises
    ------
    Exception
        Whatever the source raises; see `users_code`.
    """
    lines = source.decode(errors="replace").splitlines(keepends=True)
    linecache.cache[file] = len(source), None, lines, file  # for tracebacks
    sys.modules[module.__name__] = module
    try:
        with users_code(file):
            exec(compile(source, file, "exec", dont_inherit=True), module.__dict__)
    except Exception:
        sys.modules.pop(module.__name__, None)
        raise


_ENDINGS: Final = {name: getattr(posix, name) for name in ("_exit", "execv", "execve")}
"""Functions that end a process, or replace it, without an exception."""

_INSIDE: Final = threading.local()
"""`owner`: the process whose thread executes code of the user's; None outside."""


@cache
def _refuse_endings() -> None:
    """Let these functions raise an EndedError within `users_code`, but not in its children."""
    for name, original in _ENDINGS.items():
        refusing = _refusing(name, original)
        setattr(os, name, refusing)
        setattr(posix, name, refusing)


def _refusing(name: str, original: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(original)
    def refusing(*arguments: Any, **named: Any) -> Any:
        if getattr(_INSIDE, "owner", None) == os.getpid():
            raise EndedError(f"os.{name} would end a rank")
        return original(*arguments, **named)

    return refusing
