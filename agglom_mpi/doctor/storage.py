"""Where campaign files and compiled kernels go: the file system, its locks, its speed."""

import errno
import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from agglom_mpi.compilation import cache_folder
from agglom_mpi.doctor.finding import Finding

SHARED: Final = {"lustre", "gpfs", "beegfs", "nfs", "nfs4", "cifs", "smb3", "panfs", "ceph", "9p"}
"""File systems that several machines see."""
REMOTE: Final = {"nfs", "nfs4", "cifs", "smb3", "9p"}
"""Those that do not keep what two machines write at the same time apart."""
SLOW_SYNC: Final = 0.5
"""Seconds of an fsync from which a campaign of short generations feels it."""
LITTLE: Final = 2**30
"""Bytes of free space that are soon used up."""


def look(folder: Path) -> Iterator[Finding]:
    """Try the folder of the campaign files, and that of the compiled kernels."""
    yield _output(folder)
    kernels = cache_folder()
    kind = file_system(kernels)
    advice = ""
    if kind in SHARED:
        advice = "slow where many ranks load it: export NUMBA_CACHE_DIR=/tmp/numba_$(id -u)"
    compiled = sum(1 for _ in kernels.rglob("*.nbi"))
    state = f"{compiled} compiled" if compiled else "none compiled yet, 20 to 50 s for a new scene"
    yield Finding("kernel cache", f"{kernels} ({kind}), {state}", advice)


def _output(folder: Path) -> Finding:
    kind = file_system(folder)
    try:
        seconds, locks = _try(folder)
    except OSError as error:
        found = f"{folder} ({kind}): {error.strerror}"
        return Finding("campaign files", found, "start runs in a folder of yours", broken=True)
    free = shutil.disk_usage(folder).free
    found = f"{folder} ({kind}), {free / 2**30:.1f} GiB free, fsync {seconds * 1e3:.1f} ms"
    advice = []
    if kind in REMOTE:
        advice.append("let rank 0 write all: --database gathered")
    if not locks:
        advice.append("it has no locks: nothing keeps two runs from writing the same file")
    if seconds > SLOW_SYNC:
        advice.append("slow: each generation waits for it")
    if free < LITTLE:
        advice.append("little space: `agglom check CAMPAIGN` says how much a file takes")
    return Finding("campaign files", found, "; ".join(advice))


def _try(folder: Path) -> tuple[float, bool]:
    """Write and lock a file that is gone afterwards; seconds of the fsync, and if locks work."""
    with tempfile.NamedTemporaryFile(dir=folder, prefix=".agglom_doctor_") as file:
        try:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            locks = True
        except OSError as error:
            if error.errno == errno.EWOULDBLOCK:
                raise
            locks = False
        file.write(bytes(2**20))
        file.flush()
        begin = time.monotonic()
        os.fsync(file.fileno())
        return time.monotonic() - begin, locks


def file_system(folder: Path, mounts: Path = Path("/proc/mounts")) -> str:
    """Kind of file system that a folder is on, as the kernel calls it; `unknown` elsewhere."""
    best, kind = "", "unknown"
    place = os.path.realpath(folder)
    try:
        lines = mounts.read_text().splitlines()
    except OSError:
        return kind
    for line in lines:
        _, point, name, *_ = line.split(" ")
        point = point.encode().decode("unicode_escape")  # a blank is \040
        inside = place == point or place.startswith(point.rstrip("/") + "/")
        if inside and len(point) >= len(best):
            best, kind = point, name
    return kind
