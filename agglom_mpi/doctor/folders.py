"""Checks of the file systems of campaign files and of compiled kernels."""

import errno
import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from agglom_mpi.compilation.kernels import cache_folder
from agglom_mpi.doctor.machine import Finding

INCOHERENT_FILE_SYSTEMS: Final = {"nfs", "nfs4", "cifs", "smb3", "9p"}
"""Shared file systems on which concurrent writes of two machines can mix."""
SHARED_FILE_SYSTEMS: Final = INCOHERENT_FILE_SYSTEMS | {"lustre", "gpfs", "beegfs", "panfs", "ceph"}
"""File systems shared by several machines."""
SLOW_FSYNC: Final = 0.5
"""Minimum time of an fsync, s, that slows down campaigns of short generations."""
LITTLE_SPACE: Final = 2**30
"""Free space, bytes, below which a warning is given."""


def check_storage(folder: Path) -> Iterator[Finding]:
    """Yield the state of the folders of campaign files and of compiled kernels."""
    yield _campaign_folder(folder)
    kernels = cache_folder()
    kind = file_system(kernels)
    advice = ""
    if kind in SHARED_FILE_SYSTEMS:
        advice = "slow where many ranks load it: export NUMBA_CACHE_DIR=$(mktemp -d)"
    compiled = sum(1 for _ in kernels.rglob("*.nbi"))
    state = f"{compiled} compiled" if compiled else "none compiled yet: a first run compiles them"
    yield Finding("kernel cache", f"{kernels} ({kind}), {state}", advice)


def _campaign_folder(folder: Path) -> Finding:
    kind = file_system(folder)
    try:
        seconds, locks = measure_fsync(folder)
    except OSError as error:
        found = f"{folder} ({kind}): {error.strerror}"
        return Finding(
            "campaign files", found, "start runs in a folder that you can write to", broken=True
        )
    free = shutil.disk_usage(folder).free
    found = f"{folder} ({kind}), {free / 2**30:.1f} GiB free, fsync {seconds * 1e3:.1f} ms"
    advice = []
    if kind in INCOHERENT_FILE_SYSTEMS:
        advice.append("let rank 0 write all: --database gathered")
    if not locks:
        advice.append("it has no locks, so nothing keeps two runs from writing the same file")
    if seconds > SLOW_FSYNC:
        advice.append("slow: each generation waits for it")
    if free < LITTLE_SPACE:
        advice.append("little space: `agglom check CAMPAIGN` estimates the size of a file")
    return Finding("campaign files", found, "; ".join(advice))


def measure_fsync(folder: Path) -> tuple[float, bool]:
    """Write and lock a temporary file; return the time of its fsync, s, and whether locks work."""
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
    """Return the type of file system of a folder, as Linux names it, or `unknown`."""
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
