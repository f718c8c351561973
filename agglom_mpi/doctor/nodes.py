"""Checks for jobs on several nodes: networks that mislead a launcher, and the loss of a node."""

import os
import re
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from agglom_mpi.doctor.findings import Finding
from agglom_mpi.launcher import find_launcher

LOCAL_NETWORKS: Final = re.compile(r"docker|virbr|lxcbr|lxdbr|podman|cni|br-")
"""Beginnings of the names of networks within a machine; several machines use the same addresses."""
NETWORK_DEVICES: Final = Path("/sys/class/net")
"""Folder with an entry for each network device (Linux)."""
ANSWER_TIMEOUT: Final = 20.0
"""Time limit for an answer of a launcher or of Slurm, s."""
OPEN_MPI_NETWORK: Final = (
    "Open MPI may wait for ever for a rank on another node; export OMPI_MCA_btl_tcp_if_include and "
    "OMPI_MCA_oob_tcp_if_include with the network of the nodes, for example 10.0.0.0/24"
)
"""Advice where Open MPI may choose a network within the machine."""
OPEN_MPI_LOSS: Final = (
    "OMPI_MCA_oob_tcp_keepalive_time=5, …_intvl=5 and …_probes=3 let mpirun end the job 18 s "
    "after a link is cut, instead of 8 min"
)
"""How Open MPI notices a cut link."""
MPICH_LOSS: Final = (
    "with ServerAliveInterval 10 in ~/.ssh/config mpirun ends when rank 0 does after a link is "
    "cut, else it may stay"
)
"""How MPICH's launcher notices a cut link."""


def check_nodes(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Yield how launchers notice that a node is lost, and networks that Open MPI must not use."""
    launcher = find_launcher(environment)
    version = "" if launcher is None else _output_of([launcher, "--version"], environment)
    if "HYDRA" in version:
        yield Finding("lost node", MPICH_LOSS)
    elif "Open MPI" in version or "OpenRTE" in version:
        yield Finding("lost node", OPEN_MPI_LOSS)
        found = ", ".join(local_networks())
        if found and "OMPI_MCA_btl_tcp_if_include" not in environment:
            yield Finding("networks", f"{found} in this machine alone", OPEN_MPI_NETWORK)
    configuration = _output_of(["scontrol", "show", "config"], environment)
    limit = re.search(r"SlurmdTimeout\s*= (\d+ sec)", configuration)
    if limit:
        found = f"srun ends the job {limit[1]} or more after a node is lost (SlurmdTimeout)"
        yield Finding("lost node", found)


def local_networks(devices: Path = NETWORK_DEVICES) -> list[str]:
    """Return the names of networks within this machine, as containers have them."""
    try:
        return sorted(path.name for path in devices.iterdir() if LOCAL_NETWORKS.match(path.name))
    except OSError:
        return []


def _output_of(words: list[str], environment: Mapping[str, str]) -> str:
    """Return what a command prints; empty if it fails."""
    try:
        done = subprocess.run(
            words,
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=ANSWER_TIMEOUT,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout if done.returncode == 0 else ""
