"""What ranks return of the ranges that a scheduler has given them."""

import numpy as np

from agglom_mpi.runtime.messages import PART
from agglom_mpi.scheduling.in_flight import SampleRange
from agglom_mpi.scheduling.interface import ReturnedPart


def give_back(scheduler, rank, count):
    """Let a rank return its next samples; return each range with the places of what is new."""
    found = []
    while count:
        string, first, size, *_ = next(scheduler.in_flight.ranges(rank))
        part = ReturnedPart(string, first, min(size, count), left_out=False)
        found.append((SampleRange(*part[:3]), scheduler.returned(rank, part)))
        count -= part.size
    return found


def parts_of(rows, left_out=()):
    """Return the parts of a message of rows, one a string; of some strings others are left out."""
    strings = dict.fromkeys([*rows["string"].tolist(), *left_out])
    parts = np.zeros(len(strings), PART)
    for part, string in zip(parts, strings, strict=True):
        of_string = rows["sample"][rows["string"] == string]
        part["string"], part["size"] = string, len(of_string)
        part["first"] = of_string.min(initial=1 << 40) if len(of_string) else 0
        part["left_out"] = string in left_out
    return parts
