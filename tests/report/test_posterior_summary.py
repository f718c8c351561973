"""What to measure next, in the forms of the report."""

import csv
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.formatting import without_nan
from agglom_mpi.inference.next_measurement import NextMeasurement, NextMeasurements
from agglom_mpi.measurements.datum import Datum, datum_name
from agglom_mpi.measurements.quantities import AssumedError
from agglom_mpi.report.figures.figure import figures
from agglom_mpi.report.figures.posterior_figures import MAX_BARS, draw_next
from agglom_mpi.report.posterior_summary import MAX_MEASUREMENTS, _compared, next_text
from agglom_mpi.report.sections.section import plain_text
from agglom_mpi.report.set_files import PosteriorRequest
from agglom_mpi.statistics import MeanEstimate

FIVE = AssumedError(0.05, is_relative=True)


def measurement(quantity, time, volume, error=FIVE, resolved=True, unit_value=4e-3):
    name = datum_name(quantity, "mass", time)
    datum = Datum.of_value(quantity, 1.0, 1.0, "mass", time, name)
    after = MeanEstimate(volume, 0.01 * volume, 200)
    assumed = None if error is None else error.at(unit_value)
    return NextMeasurement(datum, error is None, error, unit_value, assumed, after, resolved)


@pytest.fixture
def found():
    again = measurement("temperature", None, 0.03, error=None, unit_value=300.0)
    again = replace(again, standard_error=0.5)
    first = measurement("d90", 2e-3, 0.031)
    others = [measurement("d50", 1e-3 * i, 0.05 + 0.001 * i) for i in range(1, MAX_BARS + 5)]
    unresolved = measurement("d10", None, 1e-6, resolved=False)
    return NextMeasurements(0.14, (unresolved, again, first, *others))


def test_table_has_the_quantity_its_error_and_the_share_of_the_box(found):
    text = plain_text(next_text(found, ""), 120)
    [line] = [line for line in text.splitlines() if "d90 by mass at 2 ms" in line]
    for part in ("4 mm", "± 5 %", "3.100 ± 0.031 %"):
        assert part in line
    assert "14.0 %" in text
    [line] = [line for line in text.splitlines() if line.startswith("temperature at the end")]
    assert "300 K" in line
    assert "half of its error" in line


def test_a_single_impact_is_compared_as_a_pure_number():
    impact = next(iter(load_campaign("jobs/impacts/croquet_ball.yaml").data))
    one = {"values": impact.values[:1], "covariance": impact.covariance[:1, :1]}
    impact = replace(impact, **one, impacts=impact.impacts[:1])
    ends = np.array([[0.77], [0.84]])
    predicted = SimpleNamespace(datum=impact, p_value=0.5, verdict="", quantiles=lambda _: ends)
    row = _compared(predicted, "speed: 40 cm/s")
    assert row["measured"] == "0.857 ± 0.003"
    assert row["predicted"] == "0.77000 to 0.84000"


def test_a_volume_that_is_not_resolved_is_an_upper_bound(found):
    text = plain_text(next_text(found, ""), 120)
    assert [line for line in text.splitlines() if "at most" in line and line.startswith("d10")]


def test_what_has_no_room_in_the_table_is_counted(found):
    text = plain_text(next_text(found, ""), 120)
    assert sum("by mass at" in line for line in text.splitlines()) == MAX_MEASUREMENTS - 1
    assert str(len(found.ranked) - MAX_MEASUREMENTS) in text.splitlines()[-1]


def test_json_and_csv_have_every_measurement(found, tmp_path):
    rows = json.loads(json.dumps(without_nan(found.records()), allow_nan=False))
    assert [row["measurement"] for row in rows] == [each.name for each in found.ranked]
    assert rows[2]["expected_volume"] == 0.031
    assert rows[2]["error"] == pytest.approx(2e-4)
    assert [row["time"] for row in rows[:3]] == [None, None, 2e-3]

    class Posterior:
        def next_measurements(self):
            return found

    assert PosteriorRequest(True, tmp_path / "next.csv").found(Posterior()) is found
    with (tmp_path / "next.csv").open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(rows)
    assert float(table[2]["expected_volume"]) == 0.031


def test_figure_has_a_bar_for_each_of_the_best_measurements(found):
    ax = draw_next(Figure().subplots(), found)
    widths = [bar.get_width() for bar in ax.patches]
    assert len(widths) == MAX_BARS
    assert sorted(widths) == pytest.approx([100.0 * e.after.value for e in found.ranked[:MAX_BARS]])
    assert ax.get_xlim()[1] >= 14.0
    assert str(len(found.ranked) - MAX_BARS) in figures()["next_measurement"].caption(found)


def test_figure_of_repetitions_alone_can_be_drawn():
    again = measurement("temperature", None, 0.03, error=None)
    ax = draw_next(Figure().subplots(), NextMeasurements(0.1, (again,)))
    assert np.isclose(ax.patches[0].get_width(), 3.0)
