"""Campaigns whose best strings are estimated in several control volumes, and what is in files."""

import numpy as np
from reestimation_runs import FREE, fresh_bytes

from agglom_mpi.storage.reader import read_campaign


def volume_bytes(path):
    """Everything in fresh samples that must not depend on how a campaign was run, by volume."""
    file, found = read_campaign(path), {1: fresh_bytes(path)}
    for volume in file.volumes:
        rows = file.volume_rows(volume)
        names = [name for name in rows.dtype.names if name not in FREE]
        found[volume] = {name: np.ascontiguousarray(rows[name]).tobytes() for name in names}
    return found


def volume_counts(path):
    """Number of samples in each larger volume of a file that may not be there yet."""
    if not path.exists():
        return {}
    file = read_campaign(path)
    return {volume: len(file.volume_rows(volume)) for volume in file.volumes}
