"""A Slurm of one node on this machine, and what a user does with it."""

import os
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

import pytest
from campaign_runs import environment
from processes import HANG

CONFIGURATION = """
ClusterName=agglom
SlurmctldHost={controller}
SlurmUser=root
SlurmdUser=root
SlurmctldPort={port}
SlurmdPort={next_port}
AuthType=auth/none
CredType=cred/none
AuthInfo=cred_expire=5
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool/%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/log/slurmctld.log
SlurmdLogFile={folder}/log/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=sched_interval=1,bf_interval=1
SlurmdParameters=config_overrides
KillWait=5
ReturnToService=2
MailProg=/bin/true
{nodes}
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""
"""No accounts, no munge, no cgroups: one user on one machine. A requeued job waits 6 s."""
NODE = "NodeName={name} NodeAddr={address} CPUs=4 State=UNKNOWN"


def need_slurm():
    """Skip where there is no Slurm; the continuous integration must have one."""
    missing = [name for name in ("slurmctld", "slurmd", "sbatch") if shutil.which(name) is None]
    why = f"no {', '.join(missing)}" if missing else "" if os.geteuid() == 0 else "no root"
    if why and os.environ.get("CI"):
        pytest.fail(f"{why}; the tests of the Slurm scripts must not be skipped here")
    if why:
        pytest.skip(f"{why} (Debian: apt-get install slurm-wlm)")


FREE_PORT = 16817
"""Of hosts that run nothing else."""
NODE_TIMEOUT = 20
"""Time in s after which a node that does not answer is down, and its jobs end."""


class Slurm:
    """Daemons in a folder of their own; `stop` leaves none behind."""

    def __init__(self, folder):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self._start(folder, {socket.gethostname().partition(".")[0]: "127.0.0.1"}, port)

    def _start(self, folder, addresses, port, further=""):
        """Start the daemons; the first of the hosts, each with its address, controls the others."""
        self._folder = folder
        for name in ("state", "spool", "log"):
            (folder / name).mkdir()
        (controller, address), *_ = addresses.items()
        nodes = [NODE.format(name=name, address=each) for name, each in addresses.items()]
        configuration = folder / "slurm.conf"
        text = CONFIGURATION.format(
            controller=f"{controller}({address})",
            nodes="\n".join(nodes),
            folder=folder,
            port=port,
            next_port=port % 60000 + 1025,
        )
        configuration.write_text(text + further)
        kernels = os.environ.get("NUMBA_CACHE_DIR", str(folder / "kernels"))
        self.environment = environment(SLURM_CONF=str(configuration), NUMBA_CACHE_DIR=kernels)
        self("slurmctld", "-c")
        self._start_nodes()
        self.wait(lambda: self("sinfo", "-h", "-o", "%t").split() == ["idle"], "no idle node")

    def _start_nodes(self):
        self("slurmd", "-c")

    def __call__(self, *words, folder=None):
        """Run a command of Slurm's; what it printed."""
        done = subprocess.run(
            self._command(words, folder),
            env=self.environment,
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=HANG,
            check=False,
        )
        assert done.returncode == 0, f"{words}: {done.stderr}"
        return done.stdout

    def _command(self, words, folder):
        return words

    def submit(self, folder, *words):
        """Submit a script from a folder; the number of the job."""
        return self("sbatch", "--parsable", *words, folder=folder).strip()

    def about(self, job):
        """Everything that Slurm tells of a job, by name."""
        said = self("scontrol", "show", "job", "--oneliner", job)
        return dict(word.split("=", 1) for word in said.split() if "=" in word)

    def state(self, job):
        """State of a job in Slurm's words."""
        return self.about(job)["JobState"]

    def hands_signals_on(self, job):
        """Whether the script of a running job does: not in the first 15 s, nor while it starts."""
        hours, minutes, seconds = self.about(job)["RunTime"].split(":")
        return 3600 * int(hours) + 60 * int(minutes) + int(seconds) >= 18

    def restarts(self, job):
        """How many times a job was started again."""
        return int(self.about(job)["Restarts"])

    def has_ended(self, job):
        """Whether a job will not run any more."""
        return self.state(job) not in ("PENDING", "RUNNING", "COMPLETING", "REQUEUED")

    def wait(self, condition, complaint, seconds=400.0):
        """Wait until a condition holds."""
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, f"{complaint}\n{self.logs()}"
            time.sleep(0.1)

    def logs(self):
        """Return the ends of the daemons' logs."""
        logs = sorted(self._folder.glob("log/*.log"))
        return "\n".join(f"{log.name}:\n{log.read_text()[-2000:]}" for log in logs)

    def stop(self):
        """Cancel all jobs and end the daemons."""
        self("scancel", "--user=root", "--full")
        self.wait(lambda: not self("squeue", "-h", "-t", "R,CG,S").strip(), "jobs do not end")
        self._end_daemons()

    def _end_daemons(self):
        for name in ("slurmd-*", "slurmctld"):
            (path,) = self._folder.glob(f"{name}.pid")
            os.kill(int(path.read_text()), signal.SIGTERM)
            self.wait(lambda path=path: not path.exists(), f"{path} does not go")


class SlurmOfHosts(Slurm):
    """Daemons on the hosts of `two_hosts`, which end with all that these run."""

    def __init__(self, folder, hosts):
        self._hosts = list(hosts)
        addresses = {host.name: host.address for host in self._hosts}
        self._start(folder, addresses, FREE_PORT, f"SlurmdTimeout={NODE_TIMEOUT}\n")

    def _command(self, words, folder):
        return self._hosts[0].within(*words, folder=folder)

    def _start_nodes(self):
        for host in self._hosts:
            host("slurmd", "-c", env=self.environment)


def script(name):
    """Path of one of the scripts that this project ships."""
    return str(Path(__file__).parents[2] / "slurm" / name)
