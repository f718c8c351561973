"""The figure of growth: strings at the times of the data, and measurements in their units."""

import numpy as np
import pytest
from campaign_runs import finish
from measured_runs import write_measured
from measured_samples import counted_covariance

from agglom_mpi.analysis.data_fit import string_predictions
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.storage.reader import read_campaign

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

from agglom_mpi.report.figures.growth import quantile_bounds


def panels(path, **options):
    axes = open_campaign(path).plot_growth(figure=Figure(layout="constrained"), **options)
    return {ax.get_ylabel(): ax for ax in axes}


def test_there_is_a_panel_for_each_kind_of_quantity(measured_file):
    found = panels(measured_file)
    assert list(found) == [
        "mean diameter by number (µm)",
        "diameters by mass (µm)",
        "particles left",
    ]
    assert [text.get_text() for text in found["diameters by mass (µm)"].texts] == [
        "d10",
        "d50",
        "d90",
    ]


def test_curves_begin_with_the_grains_and_end_with_the_predictions(measured_file):
    best = int(open_campaign(measured_file).best()["string"][0])
    curve = panels(measured_file, string=best)["mean diameter by number (µm)"].lines[0]
    assert curve.get_xdata() == pytest.approx([0.0, 2.0, 5.0])  # ms
    _, values, _ = string_predictions(read_campaign(measured_file), best)
    mean, left = values[-2:]
    assert curve.get_ydata()[[0, -1]] == pytest.approx([100.0, 1e6 * mean])
    assert panels(measured_file)["particles left"].lines[0].get_ydata()[[0, -1]] == pytest.approx(
        [1.0, left]
    )


def test_a_measured_number_has_its_interval_at_its_time(measured_file):
    [bar] = panels(measured_file)["mean diameter by number (µm)"].containers
    assert bar.get_label() == "measured"
    [segment] = bar.lines[2][0].get_segments()
    assert segment[:, 0] == pytest.approx([5.0, 5.0])
    assert segment[:, 1] == pytest.approx([130.0 - 1.96 * 3.0, 130.0 + 1.96 * 3.0])


def test_a_quantile_of_a_curve_lies_in_a_class_that_its_errors_allow():
    edges = np.array([0.0, 1e-4, 2e-4, 3e-4, np.inf])
    shares = np.array([0.2, 0.28, 0.32, 0.2])  # 48 % below 2e-4 m, with an error of 2.5 or 0.25 %

    def bounds(counted, share):
        datum = Datum("sizes", shares, counted_covariance(shares, counted), edges=edges)
        return quantile_bounds(datum, share)

    assert bounds(400, 0.5) == (1e-4, 3e-4)
    assert bounds(40_000, 0.5) == (2e-4, 3e-4)
    assert bounds(400, 0.1) is None
    assert bounds(400, 0.9) is None


def test_data_at_a_single_time_show_no_growth(tmp_path):
    write_measured(tmp_path, at=(", time: 2 ms", ""))
    finish(tmp_path, "measured.yaml")
    figure = Figure()
    [ax] = open_campaign(tmp_path / "measured.h5").plot_growth(figure=figure)
    assert not ax.lines
    assert len(ax.texts) == 1


@pytest.mark.parametrize("name", ["data_fit", "growth"])
def test_a_string_that_is_not_judged_is_refused(measured_file, name):
    with pytest.raises(ValueError, match="string is 99999, which is not judged"):
        getattr(open_campaign(measured_file), f"plot_{name}")(99999)


@pytest.mark.parametrize("name", ["data_fit", "growth"])
def test_a_figure_of_data_is_drawn_without_warnings(measured_file, name, recwarn):
    figure = Figure((8.0, 8.0), layout="constrained")
    axes = getattr(open_campaign(measured_file), f"plot_{name}")(figure=figure)
    figure.canvas.draw()
    assert all(ax.has_data() for ax in axes)
    drawn = [each for each in recwarn if not issubclass(each.category, ResourceWarning)]
    assert [str(each.message) for each in drawn] == []
