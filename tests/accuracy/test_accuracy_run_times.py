"""Processor times in reports, and what a report says of a busy machine."""

import numpy as np
import pandas as pd
import pytest
from accuracy_rows import made_up

from agglom_mpi.accuracy.report import (
    WALL_OVER_CPU,
    ReportSection,
    ReportTable,
    busy_lines,
    loop_columns,
    time_columns,
    time_text,
)
from agglom_mpi.analysis.tables import time_on_free_core, wall_over_cpu
from agglom_mpi.stopwatch import BUSY_RATIO, TimeSpent


def section(*ratios):
    tables = (ReportTable("loops", "", pd.DataFrame({WALL_OVER_CPU: ratios})),) if ratios else ()
    return ReportSection(
        "", "", "", "", (), (*tables, ReportTable("other", "", pd.DataFrame())), (), ()
    )


def test_a_time_is_the_median_and_its_spread_the_quartiles():
    found = time_columns("run", [4e-3, 1e-3, 2e-3, 3e-3, 9.0])
    assert found == {
        "processor time per run (s)": 3e-3,
        "processor time per run, lower quartile (s)": 2e-3,
        "processor time per run, upper quartile (s)": 4e-3,
    }
    assert time_text(found, "run") == "3.0 ms (2.0 ms to 4.0 ms)"


def test_an_interruption_of_one_loop_is_no_busy_machine():
    calm, late = TimeSpent(1.1e-9, 1e-9), TimeSpent(9e-9, 1e-9)
    assert loop_columns("impact", [calm, late, calm])[WALL_OVER_CPU] == pytest.approx(1.1)


def test_a_calm_machine_is_not_mentioned():
    assert busy_lines(BUSY_RATIO, [section(), section(1.0, BUSY_RATIO, 1.0)]) == []


@pytest.mark.parametrize(
    ("samples", "loops"), [(2.5, ()), (1.0, (1.0, 3.1, 3.3)), (2.5, (1.0, 1.0, 1.0))]
)
def test_a_busy_machine_is_mentioned_with_how_busy_it_was(samples, loops):
    [line] = busy_lines(samples, [section(*loops)])
    assert "made on a busy machine" in line
    assert f"samples took {samples:.2g} times their processor time" in line
    assert ("timed loops" in line) == bool(loops)
    assert ("3.1" in line) == (3.1 in loops)


def test_times_of_a_file_without_processor_times_are_called_wall_clock_times():
    rows = made_up(np.ones(3), 0.5, cpu_seconds=np.nan)
    assert np.isnan(wall_over_cpu(rows))
    assert time_on_free_core(rows).tolist() == [0.5, 0.5, 0.5]
    [line] = busy_lines(wall_over_cpu(rows), [section()])
    assert "wall-clock times" in line
    assert "busy" not in line


def test_the_ratio_of_the_clocks_is_that_of_all_samples_together():
    assert wall_over_cpu(made_up(np.ones(2), 0.5, seconds=[1.0, 2.0])) == 3.0
