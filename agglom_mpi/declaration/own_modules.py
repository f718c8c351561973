"""Modules of one's own: executed from their bytes, in every process under the same name.

A component of one's own is a class of a module beside the campaign file. The bytes of the module
are read once, and nothing is imported by path: whoever pickles such a class, or the numbers of a
law of that class, pickles the bytes with it, so that ranks and other processes have the same
module. Its name has the digest of the bytes, so that two versions do not disturb each other.

Values that its functions use and its source does not state decide results, too, and are compiled
into kernels: a table that it reads, an environment variable, a constant of another package.
"""

import ast
import hashlib
import inspect
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from traceback import walk_tb
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.compilation.stages import OWN_PREFIX
from agglom_mpi.declaration.reading import SOURCE_SHA256, SOURCE_VALUES
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.declaration.users_code import EndedError, execute
from agglom_mpi.errors import named_error

Values = tuple[tuple[str, str], ...]
"""Names and texts: a number as it is, everything else by its digest."""

_KNOWN: Final = {*sys.stdlib_module_names, "agglom_mpi", "numba", "numpy", "pydantic", "scipy"}
_PLAIN: Final = (ast.Constant, ast.Name, ast.Attribute, ast.Tuple, ast.List, ast.Set, ast.Dict)
_LITERAL: Final = (*_PLAIN, ast.UnaryOp, ast.unaryop, ast.BinOp, ast.operator, ast.expr_context)


def frozen_values(module: ModuleType, source: bytes, folder: str) -> Values:
    """Return values that a source does not state, sorted by name, whatever its `folder` is."""
    used, stated = _used(compile(source, "", "exec")), _stated(ast.parse(source))
    found: dict[str, str] = {}
    for place in {*vars(module), *stated}:
        owner, _, name = place.rpartition(".")
        if name in used and not stated.get(place) and not name.startswith("__"):
            value = getattr(getattr(module, owner, None) if owner else module, name, ())
            text = "\0".join(_parts(value, used))
            text = text.replace(folder, ".") if folder else text
            is_short = len(text) < 30 and "\0" not in text
            found[place] = text if is_short else hashlib.sha256(text.encode()).hexdigest()[:16]
    return tuple(sorted((place, text) for place, text in found.items() if text))


def _used(code: CodeType) -> set[str]:
    """Return the globals and attributes that functions within code use."""
    inner = [each for each in code.co_consts if isinstance(each, CodeType)]
    is_function = code.co_flags & inspect.CO_OPTIMIZED
    return set(code.co_names if is_function else ()).union(*map(_used, inner))


def _stated(tree: ast.Module | ast.ClassDef) -> dict[str, bool]:
    """Return whether a literal or a known package gives each global and `Class.name`."""
    stated = dict.fromkeys(("math", "np", "numpy"), True)
    for each in tree.body:
        bound: Sequence[ast.AST] = [each]
        values: Sequence[ast.AST] = bound
        match each:
            case ast.ClassDef(name=name):
                stated |= {f"{name}.{inner}": is_so for inner, is_so in _stated(each).items()}
                bound, values = [], []
            case ast.ImportFrom(module=str(package), names=names):
                bound = [ast.Name(alias.asname or alias.name) for alias in names]
                values = [] if package.partition(".")[0] in _KNOWN else [each]
            case ast.FunctionDef(name=name, args=of):
                values = [*each.decorator_list, *of.defaults, *filter(None, of.kw_defaults)]
                bound = [ast.Name(name)]
            case ast.Assign(targets=bound, value=value):
                values = [value]
            case ast.AnnAssign(target=target, value=value):
                bound, values = [target], [value] if value else []
        known = {"", *(name for name, is_so in stated.items() if is_so)}
        nodes = [node for value in values for node in ast.walk(value)]
        is_so = all(isinstance(n, _LITERAL) and getattr(n, "id", "") in known for n in nodes)
        stated |= {n.id: is_so for to in bound for n in ast.walk(to) if isinstance(n, ast.Name)}
    changed = [each.names for each in ast.walk(tree) if isinstance(each, ast.Global)]
    return stated | {name: False for names in changed for name in names}


def _parts(value: Any, used: set[str], seen: tuple[Any, ...] = ()) -> Iterator[str]:
    """Yield texts that are the same only for the same value; none of code that is known."""
    root = str(getattr(value, "__module__", None) or type(value).__module__).partition(".")[0]
    is_wrapper = callable(value) and not isinstance(value, FunctionType)
    code, items = inspect.unwrap(value) if is_wrapper else value, list[Any]()
    is_own = root.startswith("agglom_")
    is_foreign, is_holding = not is_own and root not in _KNOWN, is_own or root in {"numpy", "scipy"}
    if value is None or isinstance(value, bool | int | float | complex | str | bytes | os.PathLike):
        yield os.fspath(value) if isinstance(value, os.PathLike) else repr(value)
    elif isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        yield f"{value.dtype.str} {value.shape} {value.tobytes().hex()}"
    elif isinstance(value, Mapping | list | tuple | set | frozenset):
        is_set = isinstance(value, set | frozenset)
        items = [*value, *value.values()] if isinstance(value, Mapping) else [*value]
        items = sorted(items, key=repr) if is_set else items
    elif isinstance(value, ModuleType):
        is_known = value.__name__.partition(".")[0] in _KNOWN
        items = [] if is_known else [vars(value)[name] for name in sorted(used & {*vars(value)})]
    elif isinstance(code, FunctionType) and (is_own or is_foreign):
        held = inspect.getclosurevars(code)
        kept = code.__defaults__, code.__kwdefaults__, (held.globals if is_foreign else ())
        items = [*held.nonlocals.values(), *filter(None, kept)]
        with suppress(OSError):  # it was made without a file
            yield from [inspect.getsource(code)] if is_foreign else []
    elif is_foreign or (is_holding and not isinstance(value, type)):
        items = [getattr(value, "__dict__", {})]
    for each in [each for each in items if all(each is not outer for outer in seen)]:
        yield from _parts(each, used, (*seen, value))


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
    found = walk_tb(error.__traceback__)
    lines = [line for frame, line in found if frame.f_code.co_filename == file]
    return f"{file}:{lines[-1]}" if lines else file


def own_error(error: BaseException) -> str:
    """Return an error that code of one's own has raised as one line; empty of all others."""
    if isinstance(error, EndedError):
        return str(error)
    places = [
        f"{frame.f_code.co_filename}:{line}"
        for frame, line in walk_tb(error.__traceback__)
        if str(frame.f_globals.get("__name__")).startswith(OWN_PREFIX)
    ]
    return f"{places[-1]}: {named_error(error)}" if places else ""


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
