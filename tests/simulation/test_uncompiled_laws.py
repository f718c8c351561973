"""A law of one's own that Numba cannot compile is one line with the place in its file."""

import math

import pytest
from box_runs import GAS
from own_modules import line_of, module_of

from agglom_mpi.compilation.kernels import runs_compiled
from agglom_mpi.physics.contact import ContactArea
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import (
    ConstantRestitution,
    ImpactLaws,
    PressureRestitution,
    RestitutionSolution,
)
from agglom_mpi.simulation.compilation import compile_kernels
from agglom_mpi.simulation.own_laws import UncompiledLawError, compiled_formulas, own_formulas

pytestmark = pytest.mark.skipif(not runs_compiled(), reason="nothing is compiled")
HEAD = """
from agglom_mpi.compilation.stages import inlined
from agglom_mpi.physics.restitution import Restitution, RestitutionSolution

@inlined
def helper(x):
    return x.foo + 1

class Own(Restitution):
    def solve_restitution(self, laws, pair):
"""
END = "        return RestitutionSolution(0.5, False, 0.0, False)\n"
MUTANTS = {
    "an attribute that a pair does not have": ("        x = pair.aproach\n", "pair.aproach"),
    "a number that the law does not have": ("        x = self.alpha\n", "self.alpha"),
    "a function of the module": ("        x = helper(pair.radius)\n", "x.foo"),
    "a name that is not defined": ("        x = unknown(pair)\n", "def solve"),
    "an import": ("        import numpy\n", "import numpy"),
    "a file": ("        with open('x') as f:\n            pass\n", "def solve"),
    "a list": ("        x = [pair.radius]\n        x.append(1.0)\n", "x = ["),
    "a dict": ("        s = {}\n        s['a'] = pair.radius\n", "s['a']"),
    "two kinds of result": (
        "        if pair.radius > 1.0:\n            return 0.5\n",
        "return 0.5|return Rest",
    ),
    "another result": ("        return 0.5\n", "def solve"),
    "a text as deficit": (
        "        return RestitutionSolution(True, pair.radius, 0.0, False)\n",
        "def solve",
    ),
}


def laws_with(restitution):
    area = ContactArea.Numbers(0.0, 1.0)
    return ImpactLaws(restitution, None, area, *[None] * 6, heat_capacity=math.inf)


@pytest.mark.parametrize("case", MUTANTS)
def test_what_does_not_compile_is_one_line_with_its_place(case):
    body, part = MUTANTS[case]
    text = HEAD + body + END
    numbers = module_of(text).Own.Numbers()
    with pytest.raises(UncompiledLawError) as caught:
        compiled_formulas(numbers, laws_with(numbers))
    place, _, reason = str(caught.value).partition(": ")
    assert place in {f"own.py:{line_of(text, each)}" for each in part.split("|")}
    assert 10 < len(reason) < 310
    assert "\n" not in reason


def test_a_formula_with_other_arguments_is_named_with_both():
    numbers = module_of(HEAD.replace("laws, pair", "pair") + END).Own.Numbers()
    with pytest.raises(UncompiledLawError, match=r"own.py:\d+: .*\(self, pair\).*laws, pair\)"):
        compiled_formulas(numbers, laws_with(numbers))


def test_a_formula_compiled_alone_gives_what_it_says():
    numbers = module_of(HEAD + END.replace("0.5", "pair.radius")).Own.Numbers()
    (formula,) = compiled_formulas(numbers, laws_with(numbers)).values()
    pair = ContactPair(*[0.25] * 14)
    assert formula(numbers, laws_with(numbers), pair) == RestitutionSolution(0.25, False, 0, False)


def test_formulas_of_the_package_are_not_own():
    text = HEAD + END
    own = module_of(text + "class More(Own):\n    pass\n").More
    assert list(own_formulas(own)) == ["solve_restitution"]
    assert own_formulas(ConstantRestitution) == own_formulas(PressureRestitution) == {}


def test_a_scene_whose_law_does_not_compile_ends_with_that_line():
    text = HEAD + "        x = pair.aproach\n" + END
    numbers = module_of(text).Own.Numbers()
    scene = GAS.at(GAS.parameters()).build()
    scene = scene._replace(laws=scene.laws._replace(restitution=numbers))
    with pytest.raises(UncompiledLawError) as caught:
        compile_kernels(scene)
    assert str(caught.value).startswith(f"own.py:{line_of(text, 'pair.aproach')}: ")
    assert caught.value.exit_code == 2
