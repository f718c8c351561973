"""Values that a module has read when it was executed belong to it; what its source states not."""

import sys
from types import ModuleType

import pytest

from agglom_mpi.declaration.own_modules import OwnModule, executed, frozen_values


def values_of(source, folder=""):
    """Return the values of a module, by name."""
    own = OwnModule.of("mine.py", source.encode())
    if folder:
        own = own._replace(folder=str(folder))
    return dict(executed(own).own.values)


@pytest.mark.parametrize(
    "source",
    [
        "E = 0.9\nTABLE = {1: [E, 2 * E]}\ndef f(x, n=3): return TABLE[n][0] * E",
        "import math\nfrom math import pi\nB = -2 * math.tau * pi\ndef f(x): return B + pi",
        "import numpy as np\ndef g(x, n=3): return np.interp(x, n, n)\ndef f(x): return g(x)",
        "SEEN = {}\ndef f(x):\n    SEEN[x] = 1\n    return SEEN",
        "class A:\n    table = (1.0, 2.0)\n    def f(self): return self.table",
        "import os\nE = float(os.environ['WALL'])\ndef f(x): return x",
        "import logging\nL = logging.getLogger('walls')\ndef f(x): return L.info(x)",
    ],
)
def test_what_the_source_states_or_no_function_uses_is_no_such_value(source, monkeypatch):
    monkeypatch.setenv("WALL", "0.5")
    assert values_of(source) == {}


READING = {
    "E": "import os\nE = float(os.environ['WALL'])\ndef f(x): return E * x",
    "T": "import os\ndef read(): return os.environ['WALL']\nT = [read()]\ndef f(x): return T",
    "A.t": "import os\nclass A:\n    t = os.environ['WALL']\n    def f(self): return self.t",
    "f": "import os\ndef made(t):\n    def g(x): return t\n    return g\n"
    "f = made(os.environ['WALL'])\ndef h(x): return f(x)",
    "X": "import os\nX = 1.0\nif True:\n    X = X * float(os.environ['WALL'])\ndef f(x): return X",
    "Y": "import os, numpy as np\nY = np.full(3, float(os.environ['WALL']))\ndef f(x): return Y",
    "Z": "import os\nfrom typing import NamedTuple\nclass P(NamedTuple):\n    e: float\n"
    "Z = P(float(os.environ['WALL']))\ndef f(x): return Z.e",
    "D": "import os\nD = float(os.environ['WALL'])\ndef f(x, d=D): return d * D",
}


@pytest.mark.parametrize("name", READING)
def test_a_value_that_a_function_uses_and_the_source_does_not_tell_is_one(name, monkeypatch):
    found = []
    for place, value in enumerate(("0.5", "0.7", "0.5")):
        monkeypatch.setenv("WALL", value)
        found.append(values_of(f"{READING[name]}\n# {place}"))
    assert [list(each) for each in found] == [[name]] * 3
    assert found[0] == found[2] != found[1]


def test_a_constant_and_a_function_of_another_package_are_values(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    source = "import {0} as walls\ndef f(x): return walls.E * walls.g(x)"
    found = []
    for name, wall in (("walls_a", 0.5), ("walls_b", 0.7)):
        (tmp_path / f"{name}.py").write_text(f"E = 0.9\n_W = {wall}\ndef g(x): return _W * x\n")
        found.append(values_of(source.format(name))["walls"])
    assert found[0] != found[1]


def test_the_folder_of_a_module_is_no_difference(tmp_path):
    source = "from pathlib import Path\nHERE = Path(__file__).parent\ndef f(x): return HERE"
    folders = [tmp_path / "a", tmp_path / "b"]
    modules = [OwnModule.of("mine.py", source.encode(), each) for each in folders]
    assert [executed(each).HERE for each in modules] == folders
    assert executed(modules[0]).own.values == executed(modules[1]).own.values == (("HERE", "."),)


def test_a_module_that_reads_something_else_than_in_the_campaign_is_refused(monkeypatch):
    monkeypatch.setenv("WALL", "0.5")
    own = executed(OwnModule.of("mine.py", f"{READING['E']}  # refused".encode())).own
    assert own.values == (("E", "0.5"),)
    assert executed(own).E == 0.5
    with pytest.raises(ValueError, match=r"mine\.py: E: other values"):
        executed(own._replace(values=(("E", "0.7"),)))


def test_a_value_that_changes_later_is_that_of_the_execution():
    module = ModuleType("agglom_own_later")
    source = b"import os\nCALLS = list(os.sep)\ndef f(): CALLS.append(1)"
    exec(source, module.__dict__)
    sys.modules[module.__name__] = module
    before = frozen_values(module, source, "")
    assert list(dict(before)) == ["CALLS"]
    del sys.modules[module.__name__]
