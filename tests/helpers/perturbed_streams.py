"""`pytest --perturb K`: all samples, searches and generators of tests draw other random numbers.

An expectation that holds for one lucky realisation alone fails under some K. The switch is one of
the tests: the package knows nothing of it. `perturb` replaces the two functions of the package that
make random streams of keys, NumPy's `default_rng`, and the version that campaign files name.
Programs that tests start do the same when Python starts (`perturbed/sitecustomize.py`).
"""

import importlib.machinery
import numbers
import os
import sys
from pathlib import Path

VARIABLE = "AGGLOM_TEST_PERTURBATION"
"""Hands K to the programs that tests start."""
_FOLDER = str(Path(__file__).parent / "perturbed")


def perturbation():
    """Return K of this process; 0 without a perturbation."""
    return int(os.environ.get(VARIABLE, "0"))


def perturbed_path(path):
    """Return a PYTHONPATH whose first `sitecustomize` is ours, which executes the next one."""
    if not perturbation():
        return path
    others = [part for part in path.split(os.pathsep) if part not in ("", _FOLDER)]
    return os.pathsep.join([_FOLDER, *others])


def _perturb_streams(module, k):
    generator, key_words = module.generator, module.key_words

    def other(seed):
        return seed + (k << 64)

    module.generator = lambda seed, *key: generator(other(seed), *key)
    module.key_words = lambda key: key_words((other(key[0]), *key[1:]))


def _perturb_numpy(module, k):
    make = module.default_rng

    def default_rng(seed=None):
        if not isinstance(seed, numbers.Integral | list):
            return make(seed)
        return make(module.SeedSequence(seed, spawn_key=(k,)))

    module.default_rng = default_rng


def _name_version(module, k):
    module.__version__ = f"{module.__version__}+perturbed.{k}"


_CHANGES = {
    "agglom_mpi.random_streams": _perturb_streams,
    "agglom_mpi.version": _name_version,
    "numpy.random": _perturb_numpy,
}


class _Perturbing:
    """Finds the modules of `_CHANGES`, and changes each when it is imported, not before."""

    def __init__(self, k):
        self._k = k

    def find_spec(self, name, path=None, target=None):
        if name not in _CHANGES:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is not None:
            execute = spec.loader.exec_module

            def execute_and_change(module):
                execute(module)
                _CHANGES[name](module, self._k)

            spec.loader.exec_module = execute_and_change
        return spec


def perturb(k):
    """Perturb this process, once, and the programs that it starts."""
    os.environ[VARIABLE] = str(k)
    os.environ["PYTHONPATH"] = perturbed_path(os.environ.get("PYTHONPATH", ""))
    if any(isinstance(finder, _Perturbing) for finder in sys.meta_path):
        return
    sys.meta_path.insert(0, _Perturbing(k))
    for name, change in _CHANGES.items():
        if name in sys.modules:
            change(sys.modules[name], k)


def skip_exact_bits(items):
    """Skip tests that compare with stored bits, which other random numbers cannot give."""
    if not perturbation():
        return
    import pytest  # not in programs that tests start

    skip = pytest.mark.skip(reason="compares with stored bits; random numbers are perturbed")
    for item in items:
        if item.get_closest_marker("exact_bits"):
            item.add_marker(skip)
