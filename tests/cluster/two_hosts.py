"""Two hosts on one machine, with a network between them, on which launchers start ranks.

A host is a set of Linux namespaces without names: network, host name, processes and mounts are its
own. They end with their first process, which ends with the test run, however that ends, and the
kernel then removes the network between them. Nothing remains to be taken down.
"""

import os
import shlex
import shutil
import subprocess
import uuid
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from campaign_runs import environment
from leftovers import VARIABLE
from processes import HANG, end_group, start_group, wait_for

NAMES = ("hosta", "hostb")
"""The first host starts the run, and has rank 0."""
ADDRESSES = {"hosta": "10.77.0.1", "hostb": "10.77.0.2"}
TOOLS = {
    "ip": "iproute2",
    "ssh": "openssh-client",
    "ssh-keygen": "openssh-client",
    "/usr/sbin/sshd": "openssh-server",
    "unshare": "util-linux",
    "nsenter": "util-linux",
    "setpriv": "util-linux",
}
"""Programs that set up two hosts, and Debian's packages that have them."""
CLOCK_AHEAD = Path(__file__).with_name("clock_ahead.c")
NAMESPACES = ("--net", "--uts", "--mount", "--pid")
FIRST_PROCESS = """set -e
cd {folder}
hostname {name}
mount -t tmpfs none /dev/shm
mount -t tmpfs none /run
mkdir /run/sshd
mount --bind {name} local
mount --bind hosts /etc/hosts
mount --bind {name}/boot_id /proc/sys/kernel/random/boot_id
touch local/ready
exec 2> /dev/null
set +e
while :; do sleep 1000; done
"""
"""Set up a host, and reap its processes that have lost their parent.

Shared memory and the number of the boot tell UCX which ranks share a machine. The folder `local` is
a different one on each host.
"""
SSHD = """
HostKey {folder}/host_key
AuthorizedKeysFile {folder}/user_key.pub
StrictModes no
UsePAM no
PermitRootLogin yes
PidFile none
"""
SSH = """#!/bin/sh
exec ssh -F none -o BatchMode=yes -o LogLevel=ERROR -o StrictHostKeyChecking=no \\
  -o UserKnownHostsFile=/dev/null -i {folder}/user_key $SSH_OPTIONS "$@"
"""
RUN = """#!/bin/sh
exec env -u NUMBA_CACHE_DIR -u XDG_CACHE_HOME {variables} "$@"
"""
CACHES = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
"""Variables that may name a folder of compiled kernels."""


def need_two_hosts(*others):
    """Skip where two hosts cannot be set up; the continuous integration must be able to.

    Others are programs that a test needs beside those of `TOOLS`.
    """
    why = _obstacle(TOOLS | {name: name for name in others})
    if why and os.environ.get("CI"):
        pytest.fail(f"{why}; the tests of two hosts must not be skipped here")
    if why:
        pytest.skip(why)


def _obstacle(tools):
    """Return why two hosts cannot be set up, empty if they can."""
    missing = {name: package for name, package in tools.items() if shutil.which(name) is None}
    if missing:
        packages = " ".join(dict.fromkeys(missing.values()))
        return f"no {', '.join(missing)} (Debian: apt-get install {packages})"
    if os.geteuid() != 0:
        return "no root, so no namespaces"
    words = [
        "unshare",
        *NAMESPACES,
        "--fork",
        "--mount-proc",
        "mount",
        "-t",
        "tmpfs",
        "none",
        "/run",
    ]
    tried = subprocess.run(words, capture_output=True, text=True, timeout=HANG, check=False)
    return "" if tried.returncode == 0 else f"no namespaces: {tried.stderr.strip()}"


def clock_ahead(folder, seconds):
    """Return variables that set the wall clock of a program ahead; skip without a compiler."""
    need_two_hosts("gcc")
    library = folder / "clock_ahead.so"
    words = ["gcc", "-shared", "-fPIC", "-O1", f"-DSECONDS={seconds}", "-o", library]
    subprocess.run([*words, CLOCK_AHEAD, "-ldl"], check=True, timeout=HANG)
    return {"LD_PRELOAD": str(library)}


class Host:
    """A host of its own on this machine.

    Parameters
    ----------
    folder
        Shared by all hosts; below it are the folders that are `local` on each.
    name
        One of `NAMES`.
    """

    def __init__(self, folder, name):
        self.name, self.address, self.local = name, ADDRESSES[name], folder / name
        for each in (self.local, self.local / "home", self.local / "tmp"):
            each.mkdir()
        (self.local / "boot_id").write_text(f"{uuid.uuid4()}\n")
        self._folder, self._closed = folder, None
        script = FIRST_PROCESS.format(folder=shlex.quote(str(folder)), name=name)
        words = ["setpriv", "--pdeathsig", "KILL", "unshare", *NAMESPACES, "--fork"]
        words += ["--kill-child", "--mount-proc", "bash", "-c", script]
        self._unshare = start_group(words, stdout=subprocess.DEVNULL)
        wait_for((self.local / "ready").exists, f"host {name}", self._unshare)
        (self._first,) = psutil.Process(self._unshare.pid).children()
        self._namespace = os.readlink(f"/proc/{self._first.pid}/ns/pid")

    @property
    def number(self):
        """Number of the first process."""
        return self._first.pid

    def within(self, *words, folder=None):
        """Return a command that runs another one on this host, in a folder."""
        enter = ["nsenter", "-t", str(self.number), "-n", "-u", "-m", "-p"]
        return [*enter, f"--wdns={folder or self._folder}", *map(str, words)]

    def __call__(self, *words, **options):
        """Run a command on this host, which must succeed; what it printed."""
        options |= {"capture_output": True, "text": True, "timeout": HANG, "check": False}
        done = subprocess.run(self.within(*words), **options)
        assert done.returncode == 0, f"{self.name}: {words}: {done.stderr}"
        return done.stdout

    def set_variables(self, inject=None, **variables):
        """Let ranks on this host have these variables, beside those of a fresh login.

        The first host has the home and the compiled kernels of this machine.
        """
        own, local = environment(inject), self._folder / "local"
        names = ["PATH", "PYTHONPATH", VARIABLE]
        names += [*CACHES, "HOME"] if self.name == NAMES[0] else []
        kept = {"HOME": local / "home", "TMPDIR": local / "tmp"}
        kept |= {name: own[name] for name in names if name in own} | variables
        told = [f"{name}={shlex.quote(str(text))}" for name, text in kept.items()]
        path = self.local / "run"
        path.write_text(RUN.format(variables=" ".join(told)))
        path.chmod(0o755)

    def forget_kernels(self):
        """Remove the kernels that other tests have compiled on this host, wherever they are."""
        for folder in (self.local / "home", self.local / "tmp"):
            for path in folder.iterdir():
                shutil.rmtree(path) if path.is_dir() else path.unlink()

    def close_home(self):
        """Let nobody write to the home of this host, until it is renewed."""
        home = self._folder / "local" / "home"
        self("mount", "--bind", home, home)
        self("mount", "-o", "remount,ro,bind", home)
        self._closed = home

    def renew(self):
        """Let the host be as at first, but for the kernels that it has compiled."""
        self.kill_all()
        if self._closed:
            self("umount", self._closed)
            self._closed = None
        self.set_variables()
        self("/usr/sbin/sshd", "-f", self._folder / "sshd_config")

    def connect(self, other):
        """Lay a cable to another host; both have a loopback device and an address then."""
        words = ["ip", "link", "add", "eth0", "type", "veth", "peer", "name", "eth0"]
        # Outside of its process namespace, in which the other host has no number.
        outside = ["nsenter", "-t", str(self.number), "-n"]
        subprocess.run([*outside, *words, "netns", str(other.number)], check=True, timeout=HANG)
        for host in (self, other):
            host("ip", "address", "add", f"{host.address}/24", "dev", "eth0")
            for device in ("lo", "eth0"):
                host("ip", "link", "set", device, "up")

    def cut(self):
        """Cut the cable: no packet passes, and nobody is told."""
        self("ip", "link", "set", "eth0", "down")

    def mend(self):
        """Let packets pass again."""
        self("ip", "link", "set", "eth0", "up")

    def wait_for_network(self):
        """Wait until programs see the cable and sshd listens.

        Linux reports a new state once in a second; sshd leaves its caller before it listens.
        """
        wait_for(lambda: "state UP" in self("ip", "link", "show", "eth0"), "network")
        wait_for(lambda: ":22 " in self("ss", "--listening", "--tcp", "--numeric"), "sshd")

    def processes(self):
        """Return the processes of this host but for its first, and what that waits for."""
        found = []
        for process in psutil.process_iter():
            with suppress(OSError, psutil.NoSuchProcess):
                inside = os.readlink(f"/proc/{process.pid}/ns/pid") == self._namespace
                if inside and process.pid != self.number and process.name() != "sleep":
                    found.append(process)
        return found

    def ranks(self):
        """Return the processes that are ranks of a campaign."""
        found = []
        for process in self.processes():
            with suppress(psutil.NoSuchProcess):
                words = process.cmdline()
                if words and "python" in words[0] and any("agglom-invert" in w for w in words):
                    found.append(process)
        return found

    def kill_all(self):
        """Kill all processes but the first, as a node does that runs out of memory."""
        for process in self.processes():
            with suppress(psutil.NoSuchProcess):
                process.kill()

    def end(self):
        """End all processes; the namespaces and the cable end with them."""
        end_group(self._unshare)
        psutil.wait_procs([self._first], timeout=HANG)


class TwoHosts:
    """Both hosts, with a cable between them and an SSH server on each; `end` leaves none behind.

    Parameters
    ----------
    folder
        To be made; with `run`, which starts a rank, and `ssh`, which launchers start others with.
    """

    def __init__(self, folder):
        self.folder, self._hosts = folder, []
        (folder / "local").mkdir(parents=True)
        lines = [f"{address} {name}\n" for name, address in ADDRESSES.items()]
        (folder / "hosts").write_text("".join(["127.0.0.1 localhost\n", *lines]))
        try:
            self._set_up()
        except BaseException:
            self.end()
            raise

    def _set_up(self):
        for name in NAMES:
            self._hosts.append(Host(self.folder, name))
        first, second = self._hosts
        first.connect(second)
        for name in ("host_key", "user_key"):
            first("ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", self.folder / name)
        (self.folder / "sshd_config").write_text(SSHD.format(folder=self.folder))
        path = self.folder / "ssh"
        path.write_text(SSH.format(folder=self.folder))
        path.chmod(0o755)
        self.renew()

    def __iter__(self):
        return iter(self._hosts)

    def renew(self):
        """Let both hosts be as at first, but for the kernels that they have compiled."""
        self._hosts[0].mend()
        for host in self:
            host.renew()
        for host in self:
            host.wait_for_network()

    @property
    def second(self):
        """The host without rank 0."""
        return self._hosts[1]

    @property
    def run(self):
        """Command by which each host starts a rank with its own variables."""
        return self.folder / "local" / "run"

    def end(self):
        """End all processes; the namespaces and the cable end with them."""
        for host in self._hosts:
            host.end()
