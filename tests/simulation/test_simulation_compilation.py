"""Kernels are compiled ahead, by two processes, and then nothing is compiled any more."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from processes import HANG, output_of, program
from scenes import event_periodic

from agglom_mpi.launcher import python_command
from agglom_mpi.simulation import compilation
from agglom_mpi.simulation.compilation import compile_kernels, ensure_compiled, is_compiled, kind_of
from agglom_mpi.simulation.engines import EventDriven, FixedSteps
from agglom_mpi.simulation.frames import new_frames
from agglom_mpi.simulation.initial_state import scatter
from agglom_mpi.simulation.sample import measure_sample, run_engine, simulate_scene
from agglom_mpi.simulation.sample_range import simulate_range
from agglom_mpi.simulation.trajectory import observe_particles

pytestmark = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="nothing is compiled then"
)
SCENE = event_periodic(0.9, particles=12, size_ratio=0.3, end_time=1e-4)
KERNELS = (scatter, run_engine, measure_sample, simulate_range, observe_particles)


JOB = Path(__file__).parents[2] / "jobs" / "agglomeration_2004.yaml"
COLD = """
import os, sys
if sys.argv[2] == "one process":
    os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])
from agglom_mpi import load_campaign
from agglom_mpi.simulation.impact import solve_impact
from agglom_mpi.simulation.event_driven.state import rebuild
campaign = load_campaign(sys.argv[1])
string = campaign.parameters({}, fill="centre")
for sample in range(3):
    print(campaign.simulate(string, sample).record.tobytes().hex())
print(len(solve_impact.signatures), len(rebuild.signatures))
"""


def signatures():
    return [list(kernel.signatures) for kernel in KERNELS]


def test_nothing_is_compiled_after_kernels_were_compiled_ahead():
    compile_kernels(SCENE, frames=True)
    before = signatures()
    assert all(before)
    frames = new_frames(np.array([0.0, 0.5e-4, 1e-4]), SCENE.particles)
    record, _ = simulate_scene(SCENE, np.random.default_rng(1), frames=frames)
    assert record["state"] == 1
    assert signatures() == before


def test_a_kind_of_scene_is_what_its_parts_are_and_not_their_numbers():
    other = SCENE._replace(radius=1.0, end_time=1.0, engine=EventDriven.Numbers(7))
    assert kind_of(other) == kind_of(SCENE)
    assert kind_of(SCENE._replace(engine=FixedSteps.Numbers(7))) != kind_of(SCENE)
    laws = SCENE.laws._replace(friction=EventDriven.Numbers(7))
    assert kind_of(SCENE._replace(laws=laws)) != kind_of(SCENE)


@pytest.fixture
def unmarked(tmp_path, monkeypatch):
    """Let nothing count as compiled, though machine code is in the cache."""
    compile_kernels(SCENE, frames=True)
    monkeypatch.setattr(compilation, "mark_of", lambda scene, what: tmp_path / what)
    monkeypatch.setattr(compilation, "READY", set())
    return tmp_path


def test_what_is_compiled_is_said_and_marked(unmarked):
    lines = []
    assert not is_compiled(SCENE)
    assert compile_kernels(SCENE, frames=False, show=lines.append) > 0.0
    assert lines[0] == (
        "compiling 4 kernels of a new kind of scene: placement, measurement, sequence, engine"
    )
    compiled = [line.split()[0] for line in lines[1:]]
    assert compiled == ["placement", "measurement", "sequence", "engine"]
    assert is_compiled(SCENE)
    assert not is_compiled(SCENE, frames=True)
    compile_kernels(SCENE, frames=True, show=lines.append)
    assert lines[5] == "compiling 1 kernel of a new kind of scene: frames"
    assert is_compiled(SCENE, frames=True)
    assert compile_kernels(SCENE, frames=True, show=lines.append) == 0.0
    assert len(lines) == 7


@pytest.mark.parametrize("child", ["raise SystemExit(3)", "import os; os.kill(os.getpid(), 9)"])
def test_without_the_other_process_all_is_compiled_here(unmarked, monkeypatch, child):
    monkeypatch.setattr(compilation, "CHILD_PROGRAM", child)
    ensure_compiled(SCENE)
    assert is_compiled(SCENE)


def test_where_no_process_can_be_started_all_is_compiled_here(unmarked, monkeypatch):
    def fail(*arguments, **options):
        raise BlockingIOError("Resource temporarily unavailable")

    monkeypatch.setattr(compilation.subprocess, "Popen", fail)
    ensure_compiled(SCENE)
    assert is_compiled(SCENE)


def test_the_other_process_ends_with_its_parent(tmp_path):
    """Its standard input is closed then; a cold cache keeps it busy until after that."""
    with subprocess.Popen(
        python_command(compilation.CHILD_PROGRAM),
        stdin=subprocess.PIPE,
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
    ) as process:
        process.stdin.write(pickle.dumps(sys.path) + pickle.dumps(SCENE))
        process.stdin.close()
        assert process.wait(HANG) == 1


def test_the_other_process_compiles_the_engine(unmarked, tmp_path):
    """Here it loads it from the cache that is there already."""
    with compilation.engine_compiled_elsewhere(SCENE) as finish:
        if len(os.sched_getaffinity(0)) > 1:
            assert finish() == 0


@pytest.mark.slow
def test_samples_are_the_same_bits_by_whatever_processes_kernels_are_compiled(tmp_path):
    said = []
    for way in ("one process", "two processes"):
        words = [sys.executable, "-c", COLD, str(JOB), way]
        with program(words, env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / way)}) as process:
            printed, complaint = output_of(process)
        assert process.returncode == 0, complaint
        said.append(printed.splitlines())
    assert said[0] == said[1]
    # What is compiled ahead is what the engine calls, and not another specialisation of it.
    assert said[0][-1] == "1 1"
