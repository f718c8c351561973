"""What the scripts in slurm/ ask of Slurm, and do with exit codes and signals, without a Slurm."""

import re
import signal
import subprocess
from pathlib import Path

import pytest
from campaign_runs import environment
from processes import HANG, output_of, program, wait_for
from slurm_daemons import script

SCRIPTS = sorted(Path(script("")).glob("*.sbatch"))
MPIRUN = """
trap 'echo signalled > signalled; exit 75' USR1
printf '%s ' "$@" > started
while [ ! -e end ]; do sleep 0.01; done
exit "$(cat end)"
"""


@pytest.fixture
def folder(tmp_path):
    """Return a folder with programs that only write down how they were called."""
    calls = {"mpirun": MPIRUN, "squeue": "date -d '+2 hours'", "scontrol": 'echo "$@" > requeued'}
    (tmp_path / "bin").mkdir()
    for name, text in calls.items():
        path = tmp_path / "bin" / name
        path.write_text(f"#!/bin/bash\n{text}\n")
        path.chmod(0o755)
    return tmp_path


def job(folder, name, *words, seconds=60):
    """Start a script as Slurm does, which takes it for as old as that."""
    own = environment()
    variables = {
        "PATH": f"{folder / 'bin'}:{own['PATH']}",
        "SECONDS": str(seconds),
        "SLURM_JOB_ID": "7",
        "SLURM_NTASKS": "4",
        "SLURM_ARRAY_JOB_ID": "5",
        "SLURM_ARRAY_TASK_ID": "3",
    }
    return program(["bash", script(name), *words], cwd=folder, env=own | variables)


def started(folder, process):
    """Wait for mpirun to be called; with what."""
    path = folder / "started"
    return wait_for(lambda: path.exists() and path.read_text().split(), "mpirun", process)


def takes(process, number):
    """Whether a process has said what to do at a signal."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(re.search(r"SigCgt:\s*(\w+)", status)[1], 16) >> (number - 1) & 1


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_is_valid_shell(path):
    done = subprocess.run(["bash", "-n", path], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", ["campaign", "array"])
def test_a_job_asks_to_be_signalled_before_its_end_and_to_be_requeued(name):
    text = Path(script(f"{name}.sbatch")).read_text()
    asked = re.findall(r"^#SBATCH (.*)$", text, re.M)
    assert {"--signal=B:USR1@120", "--requeue", "--open-mode=append"} <= set(asked)


def test_a_campaign_is_told_when_to_stop_and_given_what_follows_its_name(folder):
    with job(folder, "campaign.sbatch", "a.yaml", "--generations", "3") as process:
        words = started(folder, process)
        (folder / "end").write_text("0")
        output_of(process)
    *begin, seconds = words
    assert " ".join(begin) == "-n 4 agglom-invert a.yaml --generations 3 --max-walltime"
    assert 7140 - HANG < int(seconds) <= 7140


@pytest.mark.parametrize(("code", "requeued"), [(0, None), (1, None), (2, None), (75, "requeue 7")])
def test_only_a_campaign_that_stopped_early_is_requeued(folder, code, requeued):
    (folder / "end").write_text(str(code))
    with job(folder, "campaign.sbatch", "a.yaml") as process:
        output_of(process)
    path = folder / "requeued"
    assert (path.read_text().strip() if path.exists() else None) == requeued
    assert process.returncode == (0 if requeued else code)  # then it is that of scontrol


@pytest.mark.parametrize(
    ("name", "task"), [("campaign", "requeue 7"), ("array", "requeue 5_3")], ids=str
)
def test_a_signal_is_handed_on_and_the_job_requeued(folder, name, task):
    with job(folder, f"{name}.sbatch", "a.yaml") as process:
        started(folder, process)
        wait_for(lambda: takes(process, signal.SIGUSR1), "trap", process)
        process.send_signal(signal.SIGUSR1)
        output_of(process)
    assert (folder / "signalled").exists()
    assert (folder / "requeued").read_text().strip() == task


@pytest.mark.parametrize("name", ["campaign", "array"])
def test_a_signal_at_the_very_beginning_ends_nothing(folder, name):
    """Slurm sends it at once in a job that is shorter than the time that it is asked for."""
    (folder / "bin" / "squeue").write_text("#!/bin/bash\nwhile [ ! -e go ]; do sleep 0.01; done\n")
    with job(folder, f"{name}.sbatch", "a.yaml", seconds=0) as process:
        wait_for(lambda: takes(process, signal.SIGUSR1), "trap", process)
        process.send_signal(signal.SIGUSR1)
        (folder / "go").touch()
        started(folder, process)
        process.send_signal(signal.SIGUSR1)
        (folder / "end").write_text("0")
        output_of(process)
    assert process.returncode == 0
    assert not (folder / "signalled").exists()


def test_the_tasks_of_an_array_have_other_seeds_or_other_campaigns(folder):
    (folder / "end").write_text("0")
    begun = []
    several = ["0.yaml", "1.yaml", "2.yaml", "3.yaml"]
    options = ["--allow-code", "--generations", "2"]
    for words in (["a.yaml"], several, ["a.yaml", *options], [*several, *options]):
        with job(folder, "array.sbatch", *words) as process:
            output_of(process)
        begun.append((folder / "started").read_text().partition(" --max-walltime ")[0])
    said = " ".join(options)
    assert begun == [
        "-n 4 agglom-invert a.yaml --seed 3",
        "-n 4 agglom-invert 3.yaml",
        f"-n 4 agglom-invert a.yaml --seed 3 {said}",
        f"-n 4 agglom-invert 3.yaml {said}",
    ]
