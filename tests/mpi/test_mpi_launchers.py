"""What launchers do beside starting ranks: they read standard input, and hand on variables."""

import subprocess
import sys

import pytest
from campaign_runs import TINY, environment, need_mpirun, write_campaign
from processes import HANG

STARTS_ANOTHER = """
import subprocess
CONNECT
done = subprocess.run(["agglom-invert", "tiny.yaml"], capture_output=True, text=True, CLOSING)
print(done.returncode, done.stderr)
"""


def bash(line, folder):
    return subprocess.run(
        ["bash", "-c", line],
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=HANG,
        check=True,
    )


@pytest.mark.slow
@pytest.mark.parametrize(("redirection", "runs"), [("", 1), ("</dev/null", 2)])
def test_a_loop_over_a_list_that_the_launcher_has_read_is_named(tmp_path, redirection, runs):
    need_mpirun()
    for name in ("one", "two"):
        write_campaign(tmp_path / f"{name}.yaml", **TINY)
    (tmp_path / "list").write_text("one.yaml\ntwo.yaml\n")
    run = f'mpirun -n 2 agglom-invert -q "$f" {redirection}'
    done = bash(f"while read f; do {run}; done < list", tmp_path)
    assert [path.stem for path in sorted(tmp_path.glob("*.h5"))] == ["one", "two"][:runs]
    assert ("has read 9 bytes of standard input" in done.stderr) is (runs == 1)
    assert ("</dev/null" in done.stderr) is (runs == 1)


@pytest.mark.ranks(guard="runtime/test_launch.py")
@pytest.mark.parametrize(
    ("connect", "closing"),
    [
        ("", "close_fds=True"),
        ("from mpi4py import MPI", "close_fds=False"),
    ],
)
def test_a_rank_that_starts_a_run_is_told_so_in_one_line(tmp_path, connect, closing):
    need_mpirun()
    if "mpi" not in connect and "HYDRA" not in bash("mpirun --version", tmp_path).stdout:
        pytest.skip("only MPICH hands on a connection that is closed then")
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    program = STARTS_ANOTHER.replace("CONNECT", connect).replace("CLOSING", closing)
    (tmp_path / "starts.py").write_text(program)
    done = bash(f"mpirun -n 1 {sys.executable} starts.py", tmp_path)
    code, said = done.stdout.split(" ", 1)
    assert code == "2"
    assert len(said.strip().splitlines()) == 1
    assert "started by a rank" in said
    assert "env -u " in said
    assert not (tmp_path / "tiny.h5").exists()
