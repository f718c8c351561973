"""Processes of a run, as the system sees them."""

import psutil
from processes import descendants


def ranks_below(launcher):
    """Return the process numbers of the ranks that a launcher has started, in order."""
    found = []
    for process in descendants(launcher):
        try:
            words = process.cmdline()
        except psutil.NoSuchProcess:
            continue
        if words and "python" in words[0] and any("agglom-invert" in word for word in words):
            found.append(process.pid)
    return sorted(found)
