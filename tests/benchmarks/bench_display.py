"""What the display costs rank 0 with a thousand open strings.

Run with `pytest tests/benchmarks/bench_display.py -m benchmark -s`: the processor time of an
update, relative to the half second between two of them, on terminals and as log lines.
"""

import os
import time

import pytest

from agglom_mpi.display.progress import (
    Best,
    DurationStatistics,
    RunProgress,
    log_line,
    remaining_in_turns,
)
from agglom_mpi.display.terminal import LiveLines, Terminal
from agglom_mpi.runtime.coordinator import TICK

UPDATES = 2000


def progress_of(update):
    """The progress of a large run, made anew as the coordinator does."""
    return RunProgress(
        done=12,
        total=100,
        unit="generations",
        elapsed=100.0 + TICK * update,
        samples=1_000_000 + update,
        rate=123_456.0,
        busy=0.5,
        strings_open=1000,
        in_flight=100_000,
        best=Best(762, 0.01234, 0.0045, 0.0201),
        remaining=remaining_in_turns(DurationStatistics([1.0, 2.0, 1.5] * 4), 88, 0.5),
    )


def share(show):
    """Share of the time between two updates that one takes."""
    begin = time.thread_time()
    for update in range(UPDATES):
        show(progress_of(update))
    return (time.thread_time() - begin) / (UPDATES * TICK)


@pytest.mark.benchmark
@pytest.mark.parametrize("columns", [80, 120])
def test_print_the_share_of_time_of_live_lines(columns, monkeypatch):
    with open(os.devnull, "w") as stream:
        terminal = Terminal(stream, lambda: True)
        monkeypatch.setattr(os, "get_terminal_size", lambda descriptor: (columns, 40))
        found = share(LiveLines(terminal).draw)
    print(
        f"\n{columns} columns: {found:.3%} of rank 0's time, {found * TICK * 1e6:.0f} µs an update"
    )


@pytest.mark.benchmark
def test_print_the_share_of_time_of_log_lines():
    found = share(log_line)
    print(f"\nlog line: {found:.3%} of rank 0's time if there were one at each update")
