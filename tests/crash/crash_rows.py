"""What is in a campaign file by h5py alone, without a word of the package."""

import zlib

import h5py
import numpy as np

TABLES = ("strings", "results", "samples", "failures", "generations")


def whole(row):
    """Whether the checksum in a row, shape (), is that of its bytes."""
    blank = row.copy()
    blank["crc"] = 0
    return zlib.crc32(blank.tobytes()) == int(row["crc"])


def final_rows(path):
    """Bytes of every row whose done byte is set, by table and place; all of them must be whole."""
    found = {}
    if not path.exists():
        return found
    with h5py.File(path, "r", locking=False) as file:
        for name in TABLES:
            places = np.flatnonzero(file[f"{name}_done"][:])
            if not len(places):
                continue
            rows = file[name][: places[-1] + 1]
            for place in places.tolist():
                assert whole(rows[place]), f"row {place} of {name} is final, but not whole"
                found[name, place] = rows[place].tobytes()
    return found
