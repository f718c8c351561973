"""Processor times in reports, and what a report says of a busy machine."""

import numpy as np
from accuracy_rows import made_up

from agglom_mpi.accuracy.report import busy_lines, time_columns, time_text
from agglom_mpi.analysis.tables import time_on_free_core, wall_over_cpu
from agglom_mpi.stopwatch import BUSY_RATIO


def test_a_time_is_the_median_and_its_spread_the_quartiles():
    found = time_columns([4e-3, 1e-3, 2e-3, 3e-3, 9.0])
    assert found == {
        "processor time per sample (s)": 3e-3,
        "processor time per sample, lower quartile (s)": 2e-3,
        "processor time per sample, upper quartile (s)": 4e-3,
    }
    assert time_text(found) == "3.0 ms (2.0 ms to 4.0 ms)"


def test_a_busy_machine_alone_is_mentioned_with_how_busy_it_was():
    assert busy_lines(BUSY_RATIO) == []
    [line] = busy_lines(2.5)
    assert "made on a busy machine" in line
    assert "samples took 2.5 times their processor time" in line


def test_times_of_a_file_without_processor_times_are_called_wall_clock_times():
    rows = made_up(np.ones(3), 0.5, cpu_seconds=np.nan)
    assert np.isnan(wall_over_cpu(rows))
    assert time_on_free_core(rows).tolist() == [0.5, 0.5, 0.5]
    [line] = busy_lines(wall_over_cpu(rows))
    assert "wall-clock times" in line
    assert "busy" not in line


def test_the_ratio_of_the_clocks_is_that_of_all_samples_together():
    assert wall_over_cpu(made_up(np.ones(2), 0.5, seconds=[1.0, 2.0])) == 3.0
