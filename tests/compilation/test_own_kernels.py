"""Kernels for laws of one's own are kept apart from those of the package, by their modules."""

import numba
import pytest
from own_components import SPEED

from agglom_mpi.compilation.kernel_cache import own_modules_of
from agglom_mpi.compilation.stages import AS_PLAIN_PYTHON
from agglom_mpi.declaration.own_modules import OwnModule, class_in
from agglom_mpi.physics.restitution import ConstantRestitution


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
