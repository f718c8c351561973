"""Processes of a run, as the system sees them."""

import os
import time


def ranks_below(launcher):
    """Process numbers of the ranks that a launcher, here and now, has started."""
    parents, names = {}, {}
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                with open(f"/proc/{entry}/stat") as file:
                    fields = file.read().rpartition(")")[2].split()
                with open(f"/proc/{entry}/cmdline") as file:
                    names[int(entry)] = file.read()
            except OSError:
                continue
            parents[int(entry)] = int(fields[1])

    def descends(number):
        while number in parents and number != launcher:
            number = parents[number]
        return number == launcher

    return sorted(
        number
        for number in parents
        if number != launcher
        and descends(number)
        and "agglom-invert" in names[number]
        and "python" in names[number].split("\0")[0]
    )


def wait_until_gone(processes):
    """Wait for the end of processes."""
    end = time.monotonic() + 30.0
    while any(os.path.exists(f"/proc/{number}") for number in processes):
        assert time.monotonic() < end, "a rank outlives the job"
        time.sleep(0.01)
