"""The batch system, where there is one."""

import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping

from agglom_mpi.doctor.finding import Finding


def look(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Tell of Slurm which ways it can start ranks, and of a job what it was given."""
    job = environment.get("SLURM_JOB_ID")
    if job is not None:
        tasks, nodes = environment.get("SLURM_NTASKS", "1"), environment.get("SLURM_NNODES", "1")
        yield Finding("Slurm job", f"{job}: {tasks} tasks on {nodes} nodes")
    if shutil.which("srun", path=environment.get("PATH")) is None:
        return
    try:
        done = subprocess.run(
            ["srun", "--mpi=list"],
            env=dict(environment),
            capture_output=True,
            text=True,
            timeout=20.0,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        yield Finding("Slurm", f"srun gives no answer: {error}")
        return
    if done.returncode != 0:
        yield Finding("Slurm", "srun is installed, but does not find a Slurm")
        return
    words = (done.stdout + done.stderr).split()
    kinds = [kind for kind in ("pmix", "pmi2", "cray_shasta") if kind in words]
    speaks = f"srun --mpi={' or '.join(kinds)}" if kinds else "srun speaks to no MPI"
    yield Finding("Slurm", speaks, "" if kinds else "start ranks with mpirun in a batch script")
