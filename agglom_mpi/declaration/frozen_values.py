"""Values that functions of a module of one's own use, and that its source does not state.

They decide results and are compiled into kernels, but the bytes of the module do not change with
them: a table that it reads, an environment variable, a constant of another package.
"""

import ast
import hashlib
import inspect
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final

import numpy as np

Values = tuple[tuple[str, str], ...]
"""Names and texts: a number as it is, everything else by its digest."""

_KNOWN: Final = {*sys.stdlib_module_names, "agglom_mpi", "numba", "numpy", "pydantic", "scipy"}
_PLAIN: Final = (ast.Constant, ast.Name, ast.Attribute, ast.Tuple, ast.List, ast.Set, ast.Dict)
_LITERAL: Final = (*_PLAIN, ast.UnaryOp, ast.unaryop, ast.BinOp, ast.operator, ast.expr_context)


def frozen_values(module: ModuleType, source: bytes, folder: str) -> Values:
    """Return the values, sorted by name; the path of the module's `folder` is no difference."""
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
