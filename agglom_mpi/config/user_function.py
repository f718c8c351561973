"""A user's own Python function: its source is read beside the campaign, and run only if allowed.

The source of `module.py` is read once. Its bytes travel with the campaign to all ranks, which
execute them in a module that has no other name; nothing is imported by path. A campaign that was
read from a database file knows the digest alone, and cannot run anything.
"""

import hashlib
import linecache
import math
import reprlib
import sys
from collections.abc import Callable, Mapping
from functools import cache
from keyword import iskeyword
from pathlib import Path
from types import ModuleType
from typing import Any, Final, NamedTuple

LARGEST: Final = 1e100
"""Size of values that a function may return: their squares and sums are finite."""


class UserFunction(NamedTuple):
    """A function that is called by `module:function`, and the SHA-256 of its module's source.

    Without `source`, the bytes of the module, it cannot be called.
    """

    call: str
    sha256: str
    source: bytes | None = None

    @property
    def file(self) -> str:
        """Name of the module's file."""
        return f"{self.call.partition(':')[0]}.py"

    @property
    def unread(self) -> "UserFunction":
        """The same function, as one that cannot be called."""
        return self._replace(source=None)


def check_call(text: str) -> str:
    """Return what is `module:function`; a ValueError says what else it is."""
    words = text.split(":")
    if len(words) != 2 or not all(word.isidentifier() and not iskeyword(word) for word in words):
        message = f"is {text!r}; must be module:function, of module.py beside the campaign file"
        raise ValueError(message)
    return text


def read_code(folder: Path, call: str) -> UserFunction:
    """Read the source of a function's module, which is not executed.

    Raises
    ------
    ValueError
        If there is no such file, or it is not Python.
    """
    code = UserFunction(call, "")
    path = folder / code.file
    try:
        source = path.read_bytes()
    except OSError as error:
        raise ValueError(f"is {call!r}, but {path} cannot be read: {error.strerror}") from None
    try:
        compile(source, code.file, "exec", dont_inherit=True)
    except (SyntaxError, ValueError) as error:
        line = getattr(error, "lineno", None)
        place = f"{path}:{line}" if line else str(path)
        raise ValueError(f"is {call!r}, but {place}: {getattr(error, 'msg', error)}") from None
    return UserFunction(call, hashlib.sha256(source).hexdigest(), source)


def recorded_function(identity: Mapping[str, Any]) -> UserFunction | None:
    """Return what the identity of a stored campaign says of its function; None if it has none."""
    call, digest = (identity.get(f"objective.{name}") for name in ("call", "source_sha256"))
    return UserFunction(str(call), str(digest)) if call is not None and digest is not None else None


@cache
def load_function(code: UserFunction) -> Callable[[Any], Any]:
    """Execute a module's source, once in each process, and return its function.

    Raises
    ------
    ValueError
        If the source is not known, cannot be executed, or defines no such function.
    """
    if code.source is None:
        raise ValueError(f"the source of {code.call!r} is not known here")
    _, _, name = code.call.partition(":")
    module = ModuleType(f"agglom_objective_{code.sha256[:16]}")
    lines = code.source.decode(errors="replace").splitlines(keepends=True)
    linecache.cache[code.file] = len(code.source), None, lines, code.file  # shown in tracebacks
    sys.modules[module.__name__] = module  # dataclasses look their module up there
    try:
        exec(compile(code.source, code.file, "exec", dont_inherit=True), module.__dict__)
    except (Exception, SystemExit) as error:
        said = f"{type(error).__name__}: {error}"
        raise ValueError(f"is {code.call!r}, but {code.file} raises {said}") from error
    function = getattr(module, name, None)
    if not callable(function):
        raise ValueError(f"is {code.call!r}, but {code.file} defines no function {name!r}")
    return function


def evaluate(code: UserFunction, sample: Any) -> float:
    """Return what a function makes of a finished sample, which must be a finite float.

    Raises
    ------
    Exception
        What the function raises; a ValueError or TypeError if it returns something else.
    """
    try:
        value = load_function(code)(sample)
    except SystemExit as error:  # must end no rank
        raise RuntimeError(f"{code.call} asked to exit") from error
    if not isinstance(value, float):
        kind = type(value).__name__
        raise TypeError(f"{code.call} returned {reprlib.repr(value)}, a {kind}; must be a float")
    if not (math.isfinite(value) and abs(value) <= LARGEST):
        limit = f"must be finite, and in size at most {LARGEST:g}"
        raise ValueError(f"{code.call} returned {value!r}; {limit}")
    return float(value)
