"""Values that functions of a module of one's own use, and that its source does not determine.

A module may read a table, an environment variable or a constant of another package when it is
executed. Such values decide results, and are compiled into kernels, but the bytes of the module do
not change with them.
"""

import ast
import builtins
import hashlib
import inspect
import os
import sys
from collections.abc import Iterator, Mapping
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final

Values = tuple[tuple[str, str], ...]
"""Names and texts: a number as it is, everything else by its digest."""

_READING: Final = {"open", "input", "eval", "exec", "__import__", "id", "hash", "__file__"}
_PURE: Final = frozenset(
    [
        "__future__",
        "abc",
        "agglom_mpi",
        "cmath",
        "collections",
        "dataclasses",
        "enum",
        "fractions",
        "functools",
        "itertools",
        "math",
        "numbers",
        "numpy",
        "operator",
        "scipy",
        "typing",
    ]
)
"""Packages whose functions give the same in every process, apart from `_IMPURE`."""
_IMPURE: Final = frozenset(
    [
        "load",
        "loadtxt",
        "genfromtxt",
        "fromfile",
        "fromregex",
        "memmap",
        "DataSource",
        "random",
        "io",
        "loadmat",
        "datasets",
    ]
)
_KNOWN: Final = {*sys.stdlib_module_names, "agglom_mpi", "numba", "numpy", "pydantic", "scipy"}
"""Packages whose own state is not looked into."""

_Def = ast.FunctionDef | ast.AsyncFunctionDef
_SCALARS: Final = (bool, int, float, complex, str, bytes, type(None))


def frozen_values(module: ModuleType, source: bytes, folder: str) -> Values:
    """Return the values, sorted by name, that an executed module has read and its functions use.

    Parameters
    ----------
    module, source
        The module and its source.
    folder
        Its folder, whose own path is no difference between two values.
    """
    (fixed, bound), used, found = _fixed(ast.parse(source)), _used(compile(source, "", "exec")), {}
    places = {name: (name, value) for name, value in vars(module).items()}
    for kind in [each for each in vars(module).values() if isinstance(each, type)]:
        members = {f"{kind.__name__}.{name}": (name, value) for name, value in vars(kind).items()}
        places |= {name: members[name] for name in members.keys() & bound}
    for place, (name, value) in places.items():
        if name in used and place not in fixed and not name.startswith("__"):
            parts = [part.replace(folder, ".") if folder else part for part in _parts(value, used)]
            if len(parts) == 1 and len(parts[0]) < 30:
                found[place] = parts[0]
            elif parts:
                found[place] = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]
    return tuple(sorted(found.items()))


def _used(code: CodeType) -> set[str]:
    """Return the globals and attributes that functions within code use."""
    inner = [each for each in code.co_consts if isinstance(each, CodeType)]
    is_function = code.co_flags & inspect.CO_OPTIMIZED
    return set(code.co_names if is_function else ()).union(*map(_used, inner))


def _fixed(tree: ast.Module) -> tuple[set[str], set[str]]:
    """Return the globals of a module, and `Class.attribute`, that its source determines, and all.

    `given` are names that may stand in an expression whose value the source determines: of these,
    functions only if they read nothing when they are called.
    """
    given, unknown = set(dir(builtins)) - _READING, set[str]()
    fixed, found = set[str](), set[str]()

    def is_given(*nodes: ast.AST | None) -> bool:
        inside = [each for node in nodes if node is not None for each in ast.walk(node)]
        bound = {each.arg for each in inside if isinstance(each, ast.arg)}
        bound |= {e.id for e in inside if isinstance(e, ast.Name) and isinstance(e.ctx, ast.Store)}
        return not any(
            (isinstance(each, ast.Name) and each.id not in given | (bound - unknown))
            or (isinstance(each, ast.Attribute) and each.attr in _IMPURE)
            or isinstance(each, ast.Global | ast.Import | ast.ImportFrom)
            for each in inside
        )

    def read(statement: ast.stmt, prefix: str = "") -> None:
        names = {each.id for each in ast.walk(statement) if isinstance(each, ast.Name)}
        whole = plain = is_given(statement)
        if isinstance(statement, ast.Import | ast.ImportFrom):
            module = getattr(statement, "module", None) or ""
            parts = {f"{module}.{each.name}" if module else each.name for each in statement.names}
            words = [set(each.split(".")) for each in parts]
            whole = plain = all(not each & _IMPURE for each in words) and all(
                each.split(".")[0] in _PURE for each in parts
            )
            names = {(each.asname or each.name).split(".")[0] for each in statement.names}
        elif isinstance(statement, _Def):
            defaults = [*statement.args.defaults, *statement.args.kw_defaults]
            plain, names = is_given(*defaults, *statement.decorator_list), {statement.name}
        elif isinstance(statement, ast.ClassDef):
            for each in statement.body:
                read(each, f"{statement.name}.")
            names = {statement.name}
        elif isinstance(statement, ast.Assign | ast.AnnAssign):
            whole = plain = is_given(statement.value)  # the target is no reason
            targets = getattr(statement, "targets", None) or [statement.target]  # type: ignore[union-attr]
            names = {e.id for each in targets for e in ast.walk(each) if isinstance(e, ast.Name)}
        places = {prefix + name for name in names}
        found.update(places)
        (fixed.update if plain else fixed.difference_update)(places)
        if not prefix:
            (given.update if whole else given.difference_update)(names)
            (unknown.difference_update if whole else unknown.update)(names)

    for statement in tree.body:
        read(statement)
    changed = [each.names for each in ast.walk(tree) if isinstance(each, ast.Global)]
    return fixed.difference(*changed), found


def _parts(value: Any, used: set[str], seen: tuple[Any, ...] = ()) -> Iterator[str]:
    """Yield texts that are the same only for the same value; none of what is no value."""
    kind, inner = type(value), (*seen, value)
    root = str(getattr(value, "__module__", None) or kind.__module__).partition(".")[0]
    is_own = root.startswith("agglom_") and isinstance(value, type | ModuleType | FunctionType)
    items: Any = ()
    if is_own or any(each is value for each in seen):
        items = _held(value) if isinstance(value, FunctionType) else ()
    elif isinstance(value, _SCALARS):
        yield repr(value)
        return
    elif hasattr(value, "tobytes") and hasattr(value, "dtype"):  # an array or number of NumPy
        yield f"{value.dtype.str} {value.shape} {value.tobytes().hex()}"
        return
    elif isinstance(value, os.PathLike):
        yield os.fspath(value)
        return
    elif isinstance(value, Mapping):
        items = [each for pair in sorted(value.items(), key=repr) for each in pair]
    elif isinstance(value, list | tuple | set | frozenset):
        items = sorted(value, key=repr) if isinstance(value, set | frozenset) else value
    elif isinstance(value, ModuleType):
        is_known = value.__name__.partition(".")[0] in _KNOWN
        items = [] if is_known else [vars(value).get(name) for name in sorted(used)]
        items = [each for each in items if each is not None]
    elif root in _KNOWN:
        items = ()
    elif callable(value) and hasattr(inspect.unwrap(value), "__code__"):  # of another package
        function = inspect.unwrap(value)
        try:
            yield inspect.getsource(function)
        except OSError:  # it was made without a file
            yield function.__code__.co_code.hex()
        names = _used(function.__code__) & function.__globals__.keys()
        items = [*_held(function), *(function.__globals__[name] for name in sorted(names))]
    else:
        items = [getattr(value, "__dict__", {})]
    for each in items:
        yield from _parts(each, used, inner)


def _held(function: Any) -> list[Any]:
    """Return the values that a function has from where it was defined."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    return [*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values(), *cells]
