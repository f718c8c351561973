"""Provenance of a run: its sources, their revision, the versions of libraries, and the machine."""

import ast
import functools
import hashlib
import platform
import re
import socket
import time
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

import h5py

from agglom_mpi.version import __version__

_SOURCES = Path(__file__).parents[2]


def git_revision(folder: Path = _SOURCES) -> str:
    """Return the commit checked out in a folder; empty if the folder is no checkout.

    Edits since are not seen; the digest of the sources, stored beside, shows them.
    """
    # Read from the repository's files: a process under MPI should not start another.
    try:
        found = _resolve(folder / ".git")
    except (OSError, UnicodeDecodeError):
        return ""
    return found if re.fullmatch(r"[0-9a-f]{40}|[0-9a-f]{64}", found) else ""


def _resolve(git: Path) -> str:
    if git.is_file():  # of a second working tree
        git = git.parent / git.read_text().removeprefix("gitdir:").strip()
    head = (git / "HEAD").read_text().strip()
    if not head.startswith("ref:"):
        return head
    name = head.removeprefix("ref:").strip()
    common = git / "commondir"
    shared = git / common.read_text().strip() if common.is_file() else git
    if (shared / name).is_file():
        return (shared / name).read_text().strip()
    packed = (line.partition(" ") for line in (shared / "packed-refs").read_text().splitlines())
    return next((commit for commit, _, reference in packed if reference == name), "")


PACKAGE: Final = Path(__file__).parents[1]
DECIDING: Final = (
    "compilation/kernels.py",
    "compilation/stages.py",
    "outcome.py",
    "random_streams.py",
    "statistics.py",
    "variables.py",
    "declaration/*.py",
    "measurements/**/*.py",
    "physics/*.py",
    "simulation/**/*.py",
    "emulation/*.py",
    "search/**/*.py",
    # From the campaign's text to scenes, searches and ensembles.
    "config/*.py",
    "verbs/simulate.py",
    "runtime/experiment.py",
    # What a search begins with, and which strings are estimated again.
    "analysis/estimates.py",
    "analysis/ranking.py",
    "analysis/warm_start.py",
    "inference/stored_samples.py",
)
"""Files of the package that decide the results of samples and the decisions made from them."""
NOT_DECIDING: Final = (
    # Several numbers of a sample, for the feasible set.
    "emulation/joint_emulator.py",
    # Output of `agglom check`.
    "config/consequences.py",
    "config/describe.py",
    # Output of `agglom explain`.
    "config/explanation.py",
    # Warnings.
    "config/plausibility.py",
    "config/size_warnings.py",
    # Which campaigns a study compares.
    "config/answer_study.py",
    # The box for other programs.
    "simulation/stepwise.py",
)
"""Files among them that take no part in a run; a test finds those that are missing here."""
_ERROR_CLASSES: Final = ("Problem",)
_MESSAGES: Final = ("message",)
"""Classes that carry texts of errors, and names of variables that hold such texts."""
_TEXT_METHODS: Final = ("problems", "summary")
"""Methods and attributes of components that give texts."""
_NO_MEANING: Final = ("ctx", "kind", "type_comment")


@functools.cache
def sources_digest(package: Path = PACKAGE) -> str:
    """Return the SHA-256 digest of the deciding sources, 64 hexadecimal digits.

    It is over the syntax without docstrings, comments and the texts of errors, so that a better
    sentence changes nothing; and the same with any version of Python that reads the same syntax.
    """
    digest = hashlib.sha256()
    for pattern in DECIDING:
        for path in sorted(package.glob(pattern)):
            name = path.relative_to(package).as_posix()
            if name not in NOT_DECIDING:
                digest.update("\0".join([name, *_words(ast.parse(path.read_bytes()))]).encode())
    return digest.hexdigest()


def _words(node: Any, in_error: bool = False) -> Iterator[str]:
    """Yield the parts of a syntax tree in order, without absent ones and docstrings.

    Within the text of an error, where `in_error` is true, texts are left out.
    """
    if in_error and _is_text(node):
        return
    if isinstance(node, ast.AST):
        in_error = in_error or _makes_error(node)
        yield type(node).__name__
        for name, value in ast.iter_fields(node):
            if value is not None and value != [] and name not in _NO_MEANING:
                yield name
                yield from _words(value, in_error)
    elif isinstance(node, list):
        for one in node:
            if not _is_docstring(one):
                yield from _words(one, in_error)
        yield "]"
    else:
        yield repr(node)


def _makes_error(node: ast.AST) -> bool:
    """Return whether a node raises an error, or makes the text of one or of a summary."""
    if isinstance(node, ast.FunctionDef):
        return node.name in _TEXT_METHODS
    if isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = {to.id for to in targets if isinstance(to, ast.Name)}
        return not names.isdisjoint((*_MESSAGES, *_TEXT_METHODS))
    called = node.func if isinstance(node, ast.Call) else None
    return isinstance(node, ast.Raise) or (
        isinstance(called, ast.Name) and called.id in _ERROR_CLASSES
    )


def _is_text(node: Any) -> bool:
    """Return whether a node is a text, formatted or plain."""
    plain = isinstance(node, ast.Constant) and isinstance(node.value, str)
    return plain or isinstance(node, ast.JoinedStr)


def _is_docstring(node: Any) -> bool:
    return isinstance(node, ast.Expr) and _is_text(node.value)


VERSIONS: Final = ("python", "numpy", "numba", "h5py", "hdf5", "mpi", "scipy")
"""The columns of `/legs` that record library versions."""


def versions() -> dict[str, str]:
    """Return the versions of Python, HDF5 and libraries of this process."""
    found = {"python": platform.python_version(), "hdf5": h5py.version.hdf5_version}
    for package in ("numpy", "scipy", "numba", "h5py", "mpi4py"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = ""
    return found


def leg_start(
    ranks: int, mpi: str, *, nodes: int = 1, database: str = "gathered"
) -> dict[str, Any]:
    """Return the columns of `/legs` of a start of the program, which is now."""
    found = versions() | {"mpi": mpi}
    return {
        "started": time.time(),
        "ranks": ranks,
        "nodes": nodes,
        "database": database,
        "host": socket.gethostname(),
        "processor": processor(),
        "code_version": __version__,
        "sources_sha256": sources_digest(),
        "git_revision": git_revision(),
    } | {name: found[name] for name in VERSIONS}


def processor() -> str:
    """Return the model of the processor; its architecture where the system does not name it."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
