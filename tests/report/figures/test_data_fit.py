"""The figure of measured data: measurements, predictions of strings, and by how much they miss."""

import numpy as np
import pytest
from measured_samples import counted_covariance

from agglom_mpi.measurements.datum import Datum

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

from agglom_mpi.report.figures.data_fit import (
    ComparedDatum,
    Prediction,
    closed_edges,
    draw_data_fit,
)

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
    found = Prediction("#1 string 7", values, error**2 * np.eye(len(values)))
    return ComparedDatum(datum, [found], (1e-6, "µm"))


def drawn(*each):
    return draw_data_fit(Figure(layout="constrained"), list(each))


def test_a_curve_shows_shares_below_the_edges_between_classes():
    [ax, _] = drawn(compared(CURVE, [0.1, 0.6, 0.3], 0.01))
    predicted, measured = ax.lines[0], ax.lines[1]
    assert predicted.get_xdata() == pytest.approx([100.0, 200.0])  # µm
    assert predicted.get_ydata() == pytest.approx([10.0, 70.0])
    assert measured.get_ydata() == pytest.approx([20.0, 70.0])
    assert "µm" in ax.get_xlabel()


def test_areas_of_a_density_are_the_shares_of_the_classes():
    [_, ax] = drawn(compared(CURVE, [0.1, 0.6, 0.3], 0.01))
    edges = np.array([50.0, 100.0, 200.0, 400.0])  # open ends as far as in the class between
    assert closed_edges(EDGES) == pytest.approx(1e-6 * edges)
    lines = [patch for patch in ax.patches if not patch.get_fill()]
    for patch, shares in ((ax.patches[0], SHARES), (lines[0], [0.1, 0.6, 0.3])):
        values, ends, _ = patch.get_data()
        assert ends == pytest.approx(edges)
        assert values * np.diff(np.log10(ends)) == pytest.approx(100.0 * np.asarray(shares))
    hatched = [patch.get_data().edges for patch in ax.patches if patch.get_hatch()]
    assert np.array(hatched) == pytest.approx(np.array([edges[:2], edges[2:]]))


def test_a_closed_class_is_not_hatched():
    edges = np.array([5e-5, 1e-4, 2e-4, 3e-4])
    closed = Datum("sizes", SHARES, counted_covariance(SHARES, 400), "mass", edges=edges)
    [_, ax] = drawn(compared(closed, SHARES, 0.01))
    assert closed_edges(edges) == pytest.approx(edges)
    assert not [patch for patch in ax.patches if patch.get_hatch()]


def test_one_edge_between_two_open_classes_is_in_their_middle():
    low, middle, high = closed_edges(np.array([0.0, 1e-4, np.inf]))
    assert middle == 1e-4
    assert high / middle == pytest.approx(middle / low)


def test_numbers_are_in_errors_of_their_measurement():
    [ax] = drawn(compared(NUMBER, 1.8e-4, 5e-6))
    assert ax.lines[0].get_xdata()[0] == pytest.approx(3.0)
    bar = ax.containers[0].lines[2][0].get_segments()[0]
    assert np.ptp(bar[:, 0]) == pytest.approx(2 * 1.96 * 0.5)


def test_each_curve_has_two_panels_and_all_numbers_have_one():
    curve, number = compared(CURVE, SHARES, 0.01), compared(NUMBER, 1.5e-4, 5e-6)
    assert len(drawn(number, curve, curve, number)) == 5


def test_coefficients_of_impacts_are_over_their_speeds():
    impacts = np.array([[2.0, 1e-3, 1e-3, 300.0], [0.5, 1e-3, 2e-3, 300.0]])
    datum = Datum("restitution", np.array([0.6, 0.8]), 1e-4 * np.eye(2), impacts=impacts)
    found = compared(datum, [0.65, 0.75], 0.0)._replace(shown_unit=(0.01, "cm/s"))
    [ax, *_] = drawn(found, compared(NUMBER, 1.8e-4, 5e-6))
    predicted, measured = (container.lines[0] for container in ax.containers)
    assert predicted.get_xdata() == pytest.approx([200.0, 50.0])
    assert predicted.get_ydata() == pytest.approx([0.65, 0.75])
    assert measured.get_ydata() == pytest.approx([0.6, 0.8])
    assert "cm/s" in ax.get_xlabel()
