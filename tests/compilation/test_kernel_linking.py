"""Kernels whose stages are linked compute what Numba's own compilation does, in less code."""

import json
import os
import sys
from pathlib import Path

import pytest
from processes import output_of, program

from agglom_mpi.compilation.kernel_linking import COMPILER, LinkingCompiler

pytestmark = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT", "0") != "0" or COMPILER is not LinkingCompiler,
    reason="nothing is compiled, or by a version of Numba that links its own way",
)
JOBS = Path(__file__).parents[2] / "jobs"

EMITTED = """
import json, sys
import numba.core.codegen
from numba.core.compiler import Compiler
import agglom_mpi.compilation.kernel_linking as linking

emitted = []
finalize = numba.core.codegen.JITCodeLibrary._finalize_specific
def counted(self):
    emitted.append(self.name)
    finalize(self)
numba.core.codegen.JITCodeLibrary._finalize_specific = counted
if sys.argv[1] == "numba":
    linking.COMPILER = Compiler
"""
STAGES = """
from typing import NamedTuple
import numpy as np
from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.compilation.stages import dispatch, inlined, inlined_allocating, not_inlined

class Linear(NamedTuple):
    slope: float

class Square(NamedTuple):
    factor: float

@dispatch
def law(model, x): ...

@law.register(Linear)
def linear(model, x):
    return model.slope * scaled(x)

@law.register(Square)
def square(model, x):
    return model.factor * scaled(x) ** 2

@inlined
def scaled(x):
    return 3.0 * x + np.log1p(x)

@not_inlined
def rare(model, x):
    return law(model, x) - scaled(x)

@inlined_allocating
def space(n):
    return np.full(n, 0.1)

@kernel
def total(model, n):
    x, found = space(n), 0.0
    for k in range(n):
        x[k] *= k
        found += law(model, x[k]) if k % 7 else rare(model, x[k])
    return found

models = Linear(0.3), Square(1.7)
result = [total(model, 1000).hex() for model in models]
x = 0.1 * np.arange(1000.0)
once = 3.0 * x + np.log1p(x)
rarely = np.where(np.arange(1000) % 7, 0.0, once)
wanted = [(0.3 * once - rarely).sum(), (1.7 * once**2 - rarely).sum()]
assert np.allclose([float.fromhex(number) for number in result], wanted, rtol=1e-12)
"""
SCENE = """
from agglom_mpi import load_campaign
campaign = load_campaign(sys.argv[2])
strings = [campaign.parameters({"size_ratio": 0.6}) for _ in range(2)]
result = [
    campaign.simulate(string, number).record.tobytes().hex()
    for number, string in enumerate(strings)
]
"""
SHOW = """
print(json.dumps([result, len(emitted)]))
"""


def computed(way, code, folder, *arguments):
    """Return the result of code in a fresh process, and the number of libraries emitted."""
    words = [sys.executable, "-c", EMITTED + code + SHOW, way, *map(str, arguments)]
    variables = os.environ | {"NUMBA_CACHE_DIR": str(folder / way)}
    with program(words, env=variables, cwd=folder) as process:
        said, complaint = output_of(process)
    assert process.returncode == 0, complaint
    return json.loads(said)


def compare(code, folder, *arguments):
    """Assert the same bits both ways; return the numbers of libraries emitted."""
    linked, few = computed("linked", code, folder, *arguments)
    own, many = computed("numba", code, folder, *arguments)
    assert linked == own
    return few, many


def test_linked_stages_compute_the_same_bits_and_are_not_emitted(tmp_path):
    # Numba cannot cache what it reads from no file.
    path = tmp_path / "stages.py"
    path.write_text(STAGES)
    few, many = compare("sys.path.insert(0, '.'); from stages import result\n", tmp_path)
    # Without Numba's own functions: two kernels, against these and all stages of each.
    assert many - few >= 2 * 3


@pytest.mark.slow
def test_samples_are_the_same_bits_however_their_kernels_are_compiled(tmp_path):
    few, many = compare(SCENE, tmp_path, JOBS / "agglomeration_2004.yaml")
    assert few < many / 2


def test_an_unknown_version_of_numba_is_left_alone():
    from numba.core.compiler import Compiler

    from agglom_mpi.compilation.kernel_linking import TRIED, choose_compiler

    first, last = TRIED
    assert choose_compiler(first) is choose_compiler(last) is LinkingCompiler
    assert choose_compiler((last[0], last[1] + 1)) is Compiler
    assert choose_compiler((first[0], first[1] - 1)) is Compiler
