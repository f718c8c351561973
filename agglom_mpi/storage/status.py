"""The row of `/status`: what a campaign is doing."""

import time
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from agglom_mpi.formatting import printable
from agglom_mpi.storage.checksums import checksum_ok
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.table import REWRITE_SECONDS


class Status(NamedTuple):
    """State of a campaign, time of the last change (Unix, s), and the reason."""

    state: str
    updated: float
    reason: str


def status_of(rows: np.ndarray) -> Status:
    """Return the row of `/status`, (1,), as text and numbers."""
    [row] = rows
    state, reason = (printable(row[n].decode(errors="replace")) for n in ("state", "reason"))
    return Status(state, float(row["updated"]), reason)


def read_status(file: h5py.File, path: Path) -> np.ndarray:
    """Return the row of `/status`, (1,), once a run that may be rewriting it has done so."""
    rows = Rows(file["status"], path)
    status = rows.read_all()
    if not checksum_ok(status).all():
        time.sleep(REWRITE_SECONDS)
        status = rows.read_all()
    return status
