"""Are small faults in the package found by the tests of their folder? Mutation testing by a seed.

    python tests/benchmarks/injected_faults.py list
    python tests/benchmarks/injected_faults.py run FOLDER [--revision REV] [--slow] [--only 3 17]

`list` draws the faults: the same number from each of FOLDERS, the kinds in turn. `run` copies a
commit, or the working tree, into FOLDER, puts one fault after the other into the copy, and runs the
tests of that folder there until the first fails; those named like the faulty module come first.
With `--slow` the slow tests run instead. Results are added to FOLDER/found.json, so that a run that
was interrupted goes on.

Faults are drawn from the commit BASE, whatever is tested, and located in another commit by the text
of their statement; one whose text is gone is listed as gone.
"""

import argparse
import ast
import json
import os
import random
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

BASE = "cc01dc7f"
FOLDERS = (
    *("physics", "simulation", "search", "inference"),
    *("scheduling", "runtime", "storage", "config"),
)
COUNT = 60
SEED = 20261127
SECONDS = 900
"""Clock time after which a run of tests is ended, s; an endless loop counts as found."""

_TURNED = {
    **{ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt},
    **{ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.In: ast.NotIn, ast.NotIn: ast.In},
    **{ast.Is: ast.IsNot, ast.IsNot: ast.Is},
}


class Fault(NamedTuple):
    """One change of one file: the line's number, and the source of the part that is changed."""

    kind: str
    file: str
    number: int
    before: str
    after: str


def _copy(node):
    return ast.parse(ast.unparse(node), mode="eval").body


def _comparison(node):
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        changed = _copy(node)
        changed.ops = [_TURNED[type(node.ops[0])]()]
        return changed
    return None


def _sign(node):
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        if any(isinstance(side, ast.JoinedStr) for side in (node.left, node.right)):
            return None
        changed = _copy(node)
        changed.op = ast.Sub() if isinstance(node.op, ast.Add) else ast.Add()
        return changed
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return _copy(node.operand) if not isinstance(node.operand, ast.Constant) else None
    return None


def _factor(node):
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
        return ast.BinOp(_copy(node), ast.Mult(), ast.Constant(2))
    return None


def _index(node):
    if not isinstance(node, ast.Subscript) or not isinstance(node.ctx, ast.Load):
        return None
    changed = _copy(node)
    if isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, int):
        changed.slice = ast.Constant(node.slice.value + 1)
        return changed
    if isinstance(node.slice, ast.Slice) and node.slice.lower is not None:
        changed.slice.lower = ast.BinOp(changed.slice.lower, ast.Add(), ast.Constant(1))
        return changed
    return None


def _left_out(node):
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        return ast.Pass()
    return None


def _swallowed(node):
    abstract = isinstance(node, ast.Raise) and "NotImplementedError" in ast.unparse(node)
    return ast.Pass() if isinstance(node, ast.Raise) and not abstract else None


def _unlocked(node):
    if isinstance(node, ast.With) and re.search("(?<!c)lock(?!ing)", ast.unparse(node.items[0])):
        return ast.If(ast.Constant(True), node.body, [])
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        called = ast.unparse(node.value.func)
        return ast.Pass() if re.search(r"flock|\bacquire\b", called) else None
    return None


KINDS = {
    "comparison turned": _comparison,
    "sign": _sign,
    "factor": _factor,
    "index by one": _index,
    "call left out": _left_out,
    "exception swallowed": _swallowed,
    "lock not taken": _unlocked,
}


def _annotations(tree):
    """Nodes that are no code: annotations, and what they hold."""
    for node in ast.walk(tree):
        for name in ("annotation", "returns"):
            if isinstance(part := getattr(node, name, None), ast.AST):
                yield from ast.walk(part)


def faults_of(file, source):
    """All faults that the kinds can make of one module."""
    tree = ast.parse(source)
    left_out = set(_annotations(tree))
    for node in ast.walk(tree):
        if node in left_out:
            continue
        for kind, change in KINDS.items():
            changed = change(node)
            if changed is None:
                continue
            before = ast.get_source_segment(source, node)
            after = ast.unparse(ast.fix_missing_locations(changed))
            if isinstance(node, ast.expr):
                after = f"({after})"
            elif isinstance(node, ast.With):
                after = after.replace("\n", "\n" + " " * node.col_offset)
            yield Fault(kind, file, node.lineno, before, after)


def _source_at(revision, file):
    done = subprocess.run(["git", "show", f"{revision}:{file}"], capture_output=True, text=True)
    return done.stdout if done.returncode == 0 else None


def drawn(revision=BASE, count=COUNT, seed=SEED):
    """Draw faults from a commit: folders and kinds in turn, where a folder has the kind."""
    names = subprocess.run(
        ["git", "ls-tree", "-r", "--name-only", revision, "agglom_mpi"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    pool = {}
    for folder in FOLDERS:
        files = [n for n in names if n.startswith(f"agglom_mpi/{folder}/") and n.endswith(".py")]
        for file in sorted(files):
            for fault in faults_of(file, _source_at(revision, file)):
                pool.setdefault((folder, fault.kind), []).append(fault)
    generator = random.Random(seed)
    kinds, chosen = list(KINDS), []
    turn = 0
    while len(chosen) < count:
        folder = FOLDERS[turn % len(FOLDERS)]
        kind = kinds[(turn + turn // len(FOLDERS)) % len(kinds)]
        turn += 1
        if left := pool.get((folder, kind)):
            chosen.append(left.pop(generator.randrange(len(left))))
    return chosen


def put_in(fault, source):
    """Return a module's source with a fault, or None where its text is gone."""
    same = [f for f in faults_of(fault.file, source) if f[3:] == fault[3:] and f.kind == fault.kind]
    if not same:
        return None
    nearest = min(same, key=lambda f: abs(f.number - fault.number))
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if (
            getattr(node, "lineno", None) == nearest.number
            and ast.get_source_segment(source, node) == fault.before
        ):
            lines = source.encode().splitlines(keepends=True)
            head = b"".join(lines[: node.lineno - 1]) + lines[node.lineno - 1][: node.col_offset]
            tail = lines[node.end_lineno - 1][node.end_col_offset :]
            tail += b"".join(lines[node.end_lineno :])
            return (head + fault.after.encode() + tail).decode()
    return None


def _ordered_tests(copy, fault):
    """Test files of the fault's folder; those of its module first, then those that name it."""
    folder, module = Path(fault.file).parts[1], Path(fault.file).stem
    files = sorted((copy / "tests" / folder).glob("test_*.py"))

    def rank(path):
        text = path.read_text()
        return (module not in path.name, not re.search(rf"\b{module}\b", text), path.name)

    return [str(path.relative_to(copy)) for path in sorted(files, key=rank)]


def found_by(copy, fault, slow):
    """Name of the first test that fails with the fault in place; None if all pass."""
    environment = os.environ | {
        "PYTHONPATH": str(copy),
        "NUMBA_CACHE_DIR": str(copy.parent / "kernels"),
    }
    tier = ["-m", "slow and not parallel_hdf5"] if slow else []
    command = [sys.executable, "-m", "pytest", "-x", "-p", "no:cacheprovider", *tier]
    try:
        done = subprocess.run(
            [*command, *_ordered_tests(copy, fault)],
            **{"cwd": copy, "env": environment, "timeout": SECONDS, "stdin": subprocess.DEVNULL},
            **{"capture_output": True, "text": True, "start_new_session": True},
        )
    except subprocess.TimeoutExpired:
        return f"not ended after {SECONDS} s"
    if done.returncode in (0, 5):
        return None
    told = re.search(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.M)
    return told.group(1) if told else f"exit code {done.returncode}"


def copy_tree(revision, copy):
    """Copy a commit, or the working tree where no revision is named."""
    shutil.rmtree(copy, ignore_errors=True)
    copy.mkdir(parents=True)
    what = (
        revision
        or subprocess.run(
            ["git", "stash", "create"], capture_output=True, text=True, check=True
        ).stdout.strip()
    )
    archive = subprocess.run(["git", "archive", what or "HEAD"], capture_output=True, check=True)
    subprocess.run(["tar", "-x", "-C", copy], input=archive.stdout, check=True)


def run(folder, revision, slow, only):
    """Test all faults that FOLDER/found.json does not hold yet, and print a line for each."""
    folder = folder.resolve()
    copy, results = folder / "tree", folder / "found.json"
    copy_tree(revision, copy)
    found = json.loads(results.read_text()) if results.exists() else {}
    for number, fault in enumerate(drawn(), 1):
        key = f"{number}{' slow' if slow else ''}"
        if key in found or (only and number not in only):
            continue
        path = copy / fault.file
        source = path.read_text() if path.exists() else ""
        faulty = put_in(fault, source)
        begun = time.monotonic()
        if faulty is None:
            found[key] = "gone"
        else:
            path.write_text(faulty)
            found[key] = found_by(copy, fault, slow)
            path.write_text(source)
        print(f"{_line(number, fault)} | {found[key] or '-'} | {time.monotonic() - begun:.0f} s")
        sys.stdout.flush()
        results.write_text(json.dumps(found, indent=1))


def _line(number, fault):
    shown = " ".join(fault.before.split())
    return f"{number} | {fault.kind} | {fault.file}:{fault.number} | `{shown[:70]}`"


def main():
    """Read the command line."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("action", choices=("list", "run"))
    asked.add_argument("folder", type=Path, nargs="?")
    asked.add_argument("--revision", help="the working tree unless given")
    asked.add_argument("--slow", action="store_true")
    asked.add_argument("--only", type=int, nargs="+", default=())
    chosen = asked.parse_args()
    if chosen.action == "list":
        for number, fault in enumerate(drawn(), 1):
            print(_line(number, fault), "->", " ".join(fault.after.split())[:70])
    else:
        run(chosen.folder, chosen.revision, chosen.slow, chosen.only)


if __name__ == "__main__":
    main()
