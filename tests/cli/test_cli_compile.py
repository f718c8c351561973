"""`agglom compile`: kernels ahead of a run."""

import json
import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import numba
import pytest
from campaign_runs import TINY, assert_same, decisions, environment, finish, write_campaign
from processes import HANG

from agglom_mpi.cli.common import printing_log
from agglom_mpi.compilation.kernels import cache_folder
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.simulation import compilation


def test_a_campaign_is_compiled_once(agglom, tiny_folder):
    first = agglom("compile", "tiny.yaml")
    assert first.exit_code == 0
    done, total = first.stdout.splitlines()
    assert re.fullmatch(r"tiny\.yaml: compiled (before|in .+)", done)
    assert re.fullmatch(r"[\d.]+ MiB of kernels in /.+", total)
    campaign = load_campaign("tiny.yaml")
    assert compilation.is_compiled(campaign.scene.build(campaign.parameters()), frames=True)
    again = agglom("compile", "tiny.yaml", "tiny.yaml")
    assert again.stdout.splitlines()[:2] == ["tiny.yaml: compiled before"] * 2
    assert again.stderr == ""


def test_a_mistake_is_found_before_anything_is_compiled(mistaken, monkeypatch):
    monkeypatch.setattr(compilation, "compile_kernels", None)
    assert "missing.yaml" in mistaken("compile", "tiny.yaml", "missing.yaml")


def test_a_campaign_with_code_is_compiled_without_running_it(agglom, tiny_folder, tmp_path):
    text = (tiny_folder / "tiny.yaml").read_text()
    law = "objective: {law: function, call: own:worth}\n"
    path = tmp_path / "own.yaml"
    path.write_text(re.sub(r"objective: .*\n", law, text))
    (tmp_path / "own.py").write_text("raise SystemExit('executed')\n")
    done = agglom("compile", path)
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{path}: compiled")


@pytest.fixture
def unmarked_cache(agglom, tmp_path):
    """Return a folder for kernels with all machine code there is, and nothing marked compiled."""
    assert agglom("compile", "tiny.yaml").exit_code == 0
    folder = tmp_path / "cache" / cache_folder().name
    folder.mkdir(parents=True)
    for path in cache_folder().iterdir():
        if path.suffix != ".compiled":
            (folder / path.name).symlink_to(path)
    return folder.parent


@pytest.mark.slow(guard="simulation/test_simulation_compilation.py")
@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="nothing is compiled")
def test_a_simulation_says_what_it_compiles_beside_its_json_and_only_once(unmarked_cache):
    program = "from agglom_mpi.cli import agglom; agglom()"
    words = [sys.executable, "-c", program, "simulate", "tiny.yaml", "--samples", "1", "--json"]
    runs = [
        subprocess.run(
            words,
            env=environment(NUMBA_CACHE_DIR=str(unmarked_cache)),
            capture_output=True,
            text=True,
            timeout=HANG,
            check=True,
        )
        for _ in range(2)
    ]
    for done in runs:
        assert json.loads(done.stdout)["samples"] == 1
    lines = [[line for line in done.stderr.splitlines() if "compil" in line] for done in runs]
    assert lines[0][0].startswith("compiling 4 kernels of a new kind of scene: placement, ")
    assert len(lines[0]) == 5
    assert lines[1] == []


@pytest.mark.slow
@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="nothing is compiled")
def test_a_run_drops_what_it_cannot_read_of_the_cache_and_is_not_interrupted(tmp_path, agglom):
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    assert agglom("compile", tmp_path / "tiny.yaml").exit_code == 0
    folder = tmp_path / "cache" / cache_folder().name
    for path in filter(Path.is_file, cache_folder().rglob("*")):
        copy = folder / path.relative_to(cache_folder())
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.symlink_to(path)
    for index in list(folder.rglob("initial_state.scatter-*.nbi")):  # of other sources, too
        index.unlink()
        index.write_bytes(b"")
    cache = {"NUMBA_CACHE_DIR": str(folder.parent)}
    done = finish(tmp_path, "tiny.yaml", "--output", "first.h5", **cache)
    [line] = [line for line in done.stderr.splitlines() if "cannot be read" in line]
    assert line.startswith("warning: ")
    assert "initial_state.scatter-" in line
    assert str(folder) in line
    done = finish(tmp_path, "tiny.yaml", "--output", "second.h5", **cache)
    assert "cannot be read" not in done.stderr
    assert_same(tmp_path / "first.h5", decisions(tmp_path / "second.h5"))


def test_a_kernel_that_its_first_call_compiles_is_said_by_commands_alone(capsys):
    def doubled(x):
        return 2.0 * x

    doubled.__module__ = "agglom_mpi.example"
    compiled = numba.njit(doubled)
    assert compiled(1) == 2.0
    assert capsys.readouterr().err == ""
    with printing_log():
        assert compiled(1.5) == compiled(1.5) == 3.0
    said = "" if numba.config.DISABLE_JIT else "compiling the kernel doubled\n"
    assert capsys.readouterr().err == said
    assert logging.getLogger("agglom_mpi").handlers == []
