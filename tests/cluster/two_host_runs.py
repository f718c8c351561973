"""Campaigns that are started on two hosts, by each launcher."""

import sys
from pathlib import Path

import h5py
from campaign_runs import environment
from processes import output_of, program, wait_for
from slurm_daemons import SlurmOfHosts
from two_hosts import NAMES

OPEN_MPI = bool(h5py.get_config().mpi)
"""Whether this is the other build."""
LAUNCHERS = ["mpirun"] if OPEN_MPI else ["mpirun", "srun"]
GONE = 60.0
"""Time in s after which no rank may be left of a job that has lost a host."""
KEEPALIVE = {
    "SSH_OPTIONS": "-o ServerAliveInterval=10 -o ServerAliveCountMax=3",
    "OMPI_MCA_oob_tcp_keepalive_time": "5",
    "OMPI_MCA_oob_tcp_keepalive_intvl": "5",
    "OMPI_MCA_oob_tcp_keepalive_probes": "3",
}
"""Settings of slurm/README.md by which launchers notice that a link is cut."""


class Launch:
    """How a campaign is started on both hosts.

    Parameters
    ----------
    launcher
        One of `LAUNCHERS`.
    hosts
        Both.
    folder
        Of the campaign; another one is made there.
    """

    def __init__(self, launcher, hosts, folder):
        self.hosts, self._folder, self._launcher = hosts, folder, launcher
        hosts.renew()
        self._variables = environment(OMPI_MCA_plm_rsh_agent=str(hosts.folder / "ssh")) | KEEPALIVE
        if launcher == "srun":
            (folder / "slurm").mkdir()
            self._variables |= SlurmOfHosts(folder / "slurm", hosts).environment

    def _words(self, each):
        if self._launcher == "srun":
            return ["srun", "--nodes=2", f"--ntasks-per-node={each}", "--mpi=pmi2"]
        hosts = ",".join(f"{name}:{each}" for name in NAMES)
        if OPEN_MPI:
            return ["mpirun", "--host", hosts, "-n", 2 * each]
        ssh = ["-launcher", "ssh", "-launcher-exec", self.hosts.folder / "ssh"]
        return ["mpirun", *ssh, "-hosts", hosts, "-n", 2 * each]

    def start(self, *arguments, each=1):
        """Return a block in which a campaign runs, with `each` ranks on each host."""
        invert = [self.hosts.run, Path(sys.executable).parent / "agglom-invert", *arguments]
        first, _ = self.hosts
        words = first.within(*self._words(each), *invert, folder=self._folder)
        return program(words, cwd=self._folder, env=self._variables)

    def finish(self, *arguments, each=1):
        """Run a campaign to its end, which must be a good one; what was said."""
        with self.start(*arguments, each=each) as process:
            said, errors = output_of(process)
        assert process.returncode == 0, f"{said}\n{errors}"
        return said + errors

    @property
    def leaves_the_rest_to_rank_0(self):
        """Whether rank 0 may go on when the other host is lost; other launchers end it."""
        return self._launcher == "mpirun" and not OPEN_MPI

    def wait_for_end_of_ranks(self, seconds=GONE):
        """Wait until no rank is left on either host."""

        def gone():
            return not any(host.ranks() for host in self.hosts)

        wait_for(gone, "end of all ranks", seconds=seconds)
