"""Kernels call the machine code of others, of the right types alone, and read the clocks."""

import os
import time

import numpy as np
import pytest

from agglom_mpi.compilation.kernel_calls import (
    CALLEE,
    CLOCKS,
    DATE,
    PROCESSOR,
    WALL,
    callee_of,
    kernel_call,
    read_clock,
)
from agglom_mpi.compilation.kernels import kernel

COMPILED = os.environ.get("NUMBA_DISABLE_JIT", "0") == "0"


@kernel
def halve(values, factor):
    """Multiply by half of a factor; return the sum."""
    total = 0.0
    for i in range(len(values)):
        values[i] *= 0.5 * factor
        total += values[i]
    return total


call_halve = kernel_call(halve, float)


@kernel
def halve_twice(callee, values, factor):
    """Call the other kernel for each row."""
    return call_halve(callee[0], (values[0], factor)) + call_halve(callee[0], (values[1], factor))


@kernel
def read_clocks(clocks, times, timespec):
    """Read all clocks."""
    for k in range(len(clocks)):
        times[k] = read_clock(clocks[k], timespec)


def test_a_kernel_calls_another_one_by_its_address():
    values = np.arange(6.0).reshape(2, 3)
    callee = np.array([callee_of(halve, (values[0], 3.0))])
    assert callee.dtype == CALLEE
    assert halve_twice(callee, values, 3.0) == 1.5 * 15.0
    assert values.tolist() == [[0.0, 1.5, 3.0], [4.5, 6.0, 7.5]]


@pytest.mark.skipif(not COMPILED, reason="nothing is compiled")
def test_the_machine_code_for_other_types_is_refused():
    values = np.arange(6.0).reshape(2, 3)
    for other in ((values[0], 3), (values[0].astype(np.float32), 3.0)):
        with pytest.raises(RuntimeError, match="machine code of another"):
            halve_twice(np.array([callee_of(halve, other)]), values, 3.0)


def test_clocks_are_those_of_python():
    times, timespec = np.zeros(3), np.zeros(2, np.int64)
    read_clocks(CLOCKS, times, timespec)
    before = [time.monotonic(), time.thread_time(), time.time()]
    read_clocks(CLOCKS, times, timespec)
    after = [time.monotonic(), time.thread_time(), time.time()]
    for clock in (WALL, PROCESSOR, DATE):
        assert before[clock] - 1e-6 <= times[clock] <= after[clock] + 1e-6
