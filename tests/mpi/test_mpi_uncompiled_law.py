"""A law of one's own that Numba cannot compile ends a run with one line, with ranks or without."""

import pytest
from campaign_runs import invert, need_mpirun
from own_components import SPEED, write_scene

from agglom_mpi.compilation.kernels import runs_compiled

pytestmark = pytest.mark.skipif(not runs_compiled(), reason="nothing is compiled")
SOURCE = SPEED.replace("pair.approach_speed) **", "pair.aproach_speed) **")
LINE = next(i for i, text in enumerate(SOURCE.splitlines(), 1) if "aproach" in text)


@pytest.mark.ranks(guard="simulation/test_uncompiled_laws.py")
def test_a_law_that_does_not_compile_is_one_line_and_exit_code_2(tmp_path):
    need_mpirun()
    write_scene(tmp_path, SOURCE)
    done = invert(tmp_path, "own.yaml", "--allow-code", ranks=2)
    said = done.stderr.splitlines()  # launchers add that rank 0 has ended the job
    assert done.returncode == 2
    assert len([line for line in said if line.startswith(f"sticking.py:{LINE}: ")]) == 1
    assert not [word for word in ("Traceback", "numba", "pipeline") if word in done.stderr]
