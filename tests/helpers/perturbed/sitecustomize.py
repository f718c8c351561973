"""Executed by every Python program that a perturbed test run starts."""

import importlib.util
import runpy
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent


def perturb_this_process():
    name = "perturbed_streams"
    spec = importlib.util.spec_from_file_location(name, HERE.parent / f"{name}.py")
    sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[name])
    sys.modules[name].perturb(sys.modules[name].perturbation())


def execute_the_next_one():
    """Execute what a test injects, as Python would have done without this module."""
    for folder in map(Path, sys.path):
        script = folder / "sitecustomize.py"
        if folder.resolve() != HERE and script.exists():
            runpy.run_path(str(script))
            return


perturb_this_process()
execute_the_next_one()
