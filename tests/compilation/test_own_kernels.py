"""Kernels for laws of one's own are kept apart from those of the package, by their modules."""

import numba
import pytest
from own_components import SPEED

from agglom_mpi.compilation.kernel_cache import own_modules_of
from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.compilation.stages import AS_PLAIN_PYTHON
from agglom_mpi.declaration.own_modules import OwnModule, class_in
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import ConstantRestitution, solve_restitution


@pytest.mark.skipif(AS_PLAIN_PYTHON, reason="nothing is compiled")
def test_the_modules_of_one_s_own_are_found_in_the_types_of_arguments():
    own = OwnModule.of("sticking.py", SPEED.encode())
    changed = OwnModule.of("sticking.py", f"{SPEED}\n".encode())
    numbers = [
        class_in(each, "SpeedRestitution")(sticking=0.1).build({}) for each in (own, changed)
    ]
    builtin = ConstantRestitution(value=0.5).build({})
    types = [numba.typeof(each) for each in (*numbers, builtin, 1.0, (numbers[0], 1))]
    assert own_modules_of(types[2:4]) == []
    assert own_modules_of(types[:1]) == own_modules_of(types[4:]) == [own.name]
    assert own_modules_of(types) == sorted([own.name, changed.name])


@pytest.mark.skipif(AS_PLAIN_PYTHON, reason="nothing is compiled")
def test_two_versions_of_a_law_share_no_machine_code():
    """Numba names machine code by names of types; a process may have both versions."""
    source = SPEED.replace("** 0.25", "** 0.5")
    modules = [OwnModule.of("sticking.py", each.encode()) for each in (SPEED, source)]
    numbers = [class_in(each, "SpeedRestitution")(sticking=0.1).build({}) for each in modules]
    names = {str(numba.typeof(each)) for each in numbers}
    assert len(names) == 2
    pair = ContactPair(*[1.0] * len(ContactPair._fields))._replace(approach_speed=16.0)
    solved = [float(deficit_of(each, pair)) for each in numbers]
    assert solved == [0.5, 0.75]


@kernel
def deficit_of(law, pair):
    """Return 1 − e of a pair."""
    return solve_restitution(law, None, pair).deficit
