"""The figure of measured data: measurements, predictions of strings, and by how much they miss."""

import numpy as np
import pytest
from measured_samples import counted_covariance

from agglom_mpi.measurements.datum import Datum

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

from agglom_mpi.report.figures.data_fit import ComparedDatum, DrawnPrediction, draw_data_fit

SHARES = np.array([0.2, 0.5, 0.3])
EDGES = np.array([0.0, 1e-4, 2e-4, np.inf])
CURVE = Datum(
    "sizes",
    SHARES,
    counted_covariance(SHARES, 400),
    "mass",
    edges=EDGES,
    name="sizes by mass at the end",
)
NUMBER = Datum.of_value("d50", 1.5e-4, 1e-5, "mass", name="d50 by mass at the end")


def compared(datum, values, error):
    values = np.atleast_1d(values)
    found = DrawnPrediction("#1 string 7", values, error**2 * np.eye(len(values)))
    return ComparedDatum(datum, [found])


def drawn(*each):
    return draw_data_fit(Figure(layout="constrained"), list(each))


def test_a_curve_shows_shares_below_the_edges_between_classes():
    [ax] = drawn(compared(CURVE, [0.1, 0.6, 0.3], 0.01))
    predicted, measured = ax.lines[0], ax.lines[1]
    assert predicted.get_xdata() == pytest.approx([100.0, 200.0])  # µm
    assert predicted.get_ydata() == pytest.approx([10.0, 70.0])
    assert measured.get_ydata() == pytest.approx([20.0, 70.0])
    assert "µm" in ax.get_xlabel()


def test_numbers_are_in_errors_of_their_measurement():
    [ax] = drawn(compared(NUMBER, 1.8e-4, 5e-6))
    assert ax.lines[0].get_xdata()[0] == pytest.approx(3.0)
    bar = ax.containers[0].lines[2][0].get_segments()[0]
    assert np.ptp(bar[:, 0]) == pytest.approx(2 * 1.96 * 0.5)


def test_each_curve_has_a_panel_and_all_numbers_have_one():
    curve, number = compared(CURVE, SHARES, 0.01), compared(NUMBER, 1.5e-4, 5e-6)
    assert len(drawn(number, curve, curve, number)) == 3
