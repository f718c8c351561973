"""How the package starts programs of Python."""

import ast
import subprocess
from pathlib import Path

import agglom_mpi
from agglom_mpi import launcher
from agglom_mpi.launcher import python_command

PACKAGE = Path(agglom_mpi.__file__).parent
STARTS_PYTHON = ("executable", "multiprocessing", "ProcessPoolExecutor", "orig_argv")


def test_one_function_starts_all_programs_of_python():
    found = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_bytes())):
            names = {getattr(node, name, None) for name in ("attr", "id", "name", "module")}
            if names.intersection(STARTS_PYTHON):
                found.add((path.name, type(node).__name__))
    assert found == {(Path(launcher.__file__).name, "Attribute")}


def test_no_module_of_the_current_folder_takes_the_place_of_another(tmp_path):
    for name in ("pickle", "random", "mpi4py", "click", "numba", "sitecustomize"):
        (tmp_path / f"{name}.py").write_text("print('planted')")
    words = python_command("import pickle, random, mpi4py, click, agglom_mpi; print('ours')")
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == "ours\n"
