"""Modules of one's own: executed from their bytes, in every process under the same name.

A component of one's own is a class of a module beside the campaign file. The bytes of the module
are read once, and nothing is imported by path: whoever pickles such a class, or the numbers of a
law of that class, pickles the bytes with it, so that ranks and other processes have the same
module. Its name has the digest of the bytes, so that two versions do not disturb each other.
"""

import hashlib
import sys
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from agglom_mpi.compilation.stages import OWN_PREFIX
from agglom_mpi.declaration.frozen_values import Values, frozen_values
from agglom_mpi.declaration.reading import SOURCE_SHA256, SOURCE_VALUES
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.declaration.users_code import EndedError, execute
from agglom_mpi.errors import named_error


class OwnModule(NamedTuple):
    """A module of one's own.

    Attributes
    ----------
    file
        File name, `sticking.py`.
    sha256
        SHA-256 of the source, hexadecimal.
    source
        Bytes of the file.
    folder
        Where the file is, if the source asks for it.
    values
        What it has read when it was executed, see `frozen_values`; None if that is not known.
    """

    file: str
    sha256: str
    source: bytes
    folder: str = ""
    values: Values | None = None

    @classmethod
    def of(cls, file: str, source: bytes, folder: Path | None = None) -> "OwnModule":
        """Return the module of a file with this content."""
        asked = str(folder.absolute()) if folder is not None and b"__file__" in source else ""
        return cls(file, hashlib.sha256(source).hexdigest(), source, asked)

    def entries(self) -> dict[str, Any]:
        """Return the entries of an identity: the digest, and the values if there are some."""
        values = {SOURCE_VALUES: dict(self.values)} if self.values else {}
        return {SOURCE_SHA256: self.sha256, **values}

    @property
    def name(self) -> str:
        """Name of the executed module, by file and content."""
        digest = hashlib.sha256((self.sha256 + self.folder).encode()).hexdigest()
        digest = digest if self.folder else self.sha256
        return f"{OWN_PREFIX}{self.file.removesuffix('.py')}_{digest[:16]}"


class ExecutedModule(ModuleType):
    """An executed module of one's own, which knows its source as `own`.

    Its `key` keeps the machine code of its formulas apart from that with other values.
    """

    own: OwnModule
    key: str


def executed(own: OwnModule) -> ExecutedModule:
    """Execute a module, once in each process.

    Raises
    ------
    ValueError
        If it cannot be executed, with the reason and its line; or if it has read other values than
        those that `own` has, which may have less of them.
    """
    module = _executed(own._replace(values=None))
    if changed := {*(own.values or ())} - {*(module.own.values or ())}:
        named = ", ".join(sorted(name for name, _ in changed))
        raise ValueError(f"{own.file}: {named}: other values than the campaign was run with")
    return module


@cache
def _executed(own: OwnModule) -> ExecutedModule:
    """Execute a module, whose values are then known."""
    module = ExecutedModule(own.name)
    module.own = own
    module.__file__ = str(Path(own.folder) / own.file)
    try:
        execute(own.file, own.source, module)
    except EndedError as error:
        raise ValueError(str(error)) from error
    except Exception as error:
        place = line_in(own.file, error)
        raise ValueError(f"{place} raises {named_error(error)}") from error
    module.own = own._replace(values=frozen_values(module, own.source, own.folder))
    module.key = " ".join([own.name, *map(str, module.own.values or ())])
    return module


def line_in(file: str, error: BaseException) -> str:
    """Return the last place in a file that an error came through, `FILE:LINE`; else the file."""
    lines, traceback = [], error.__traceback__
    while traceback is not None:
        if traceback.tb_frame.f_code.co_filename == file:
            lines.append(traceback.tb_lineno)
        traceback = traceback.tb_next
    return f"{file}:{lines[-1]}" if lines else file


def own_error(error: BaseException) -> str:
    """Return an error that code of one's own has raised as one line; empty of all others."""
    if isinstance(error, EndedError):
        return str(error)
    place, traceback = "", error.__traceback__
    while traceback is not None:
        frame = traceback.tb_frame
        if str(frame.f_globals.get("__name__")).startswith(OWN_PREFIX):
            place = f"{frame.f_code.co_filename}:{traceback.tb_lineno}"
        traceback = traceback.tb_next
    return f"{place}: {named_error(error)}" if place else ""


def class_in(own: OwnModule, name: str) -> type[Any]:
    """Return a class that a module defines itself.

    Raises
    ------
    ValueError
        If it cannot be executed, or defines no such class.
    """
    module = executed(own)
    found = getattr(module, name, None)
    if not isinstance(found, type):
        classes = [each for each, kind in vars(module).items() if _is_own_class(kind, own)]
        hint = f"; {suggestion(name, classes)}" if classes else ""
        raise ValueError(f"{own.file} defines no class {name!r}{hint}")
    if not _is_own_class(found, own):
        raise ValueError(f"{own.file} only imports {name!r}; a class of its own may subclass it")
    return found


def _is_own_class(found: Any, own: OwnModule) -> bool:
    return isinstance(found, type) and found.__module__ == own.name


def own_module(module: str) -> OwnModule | None:
    """Return the module of one's own that an executed module is; None for all others."""
    if not module.startswith(OWN_PREFIX):
        return None
    found = sys.modules.get(module)
    return found.own if isinstance(found, ExecutedModule) else None


def reduced_class(component: type[Any]) -> Any:
    """Return how a class is pickled: by its name, or of one's own with the bytes of its module."""
    own = own_module(component.__module__)
    qualified = component.__qualname__
    return qualified if own is None else (_named_in, (own, qualified))


def _named_in(own: OwnModule, qualified: str) -> Any:
    found: Any = executed(own)
    for name in qualified.split("."):
        found = getattr(found, name)
    return found
