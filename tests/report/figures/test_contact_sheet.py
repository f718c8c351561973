"""Every type of figure is made once, with the lettering and the width of print."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.report.figures.figure import FigureOptions, figures
from agglom_mpi.report.style import PAGE, finish, log_ticks, styled, tick_text, variable_label
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.variables import PAPER_VARIABLES, Variable

LEGIBLE = 7.0, 9.0
"""Sizes of letters at print width, points."""


def sizes(drawing):
    """Return the sizes of all letters of a drawing that are shown, points."""
    with styled():
        figure = Figure(figsize=drawing.size, layout="constrained")
        axes = drawing.draw(figure)
        finish(figure.axes if axes is None else axes)
        figure.canvas.draw()
        shown = figure.findobj(Text)
        return [text.get_fontsize() for text in shown if text.get_text() and text.get_visible()]


def test_figures_of_a_campaign_have_the_lettering_and_the_width_of_print(finished):
    data = read_campaign(finished)
    shown = (figure.drawing(data, FigureOptions()) for figure in figures().values())
    for drawing in filter(None, shown):
        assert drawing.size[0] <= PAGE
        found = sizes(drawing)
        assert LEGIBLE[0] <= min(found) <= max(found) <= LEGIBLE[1], drawing.name


@pytest.mark.slow(guard="report/figures/test_figures_drawn.py")
def test_every_type_of_figure_is_on_the_contact_sheet(three, measured_file, finished, tmp_path):
    from contact_sheet import drawings_of, write_sheet

    files = [three.path, measured_file, finished]
    elsewhere = {"set_reach", "set_posterior", "finite_size", "next_measurement"}
    drawings = list(drawings_of(files, sorted(elsewhere)))
    for drawing in drawings:
        assert drawing.size[0] <= PAGE
        found = sizes(drawing)
        assert LEGIBLE[0] <= min(found) <= max(found) <= LEGIBLE[1], drawing.name
    names = write_sheet(iter(drawings), tmp_path / "sheet.png")
    posterior = {"posterior_pairs", "predictive_check"}  # of few strings there is none
    assert set(figures()) - elsewhere - posterior <= set(names)
    assert {"evolution", "map_impact"} <= set(names)
    assert (tmp_path / "sheet.png").stat().st_size < 700_000


def test_a_set_is_plotted_as_one_panel_of_a_pair_or_as_a_marginal(three, doubling):
    ax = Figure().subplots()
    assert three.plot_set("relative_speed", "hardness", ax=ax, feasible_set=doubling) is ax
    assert "relative speed v₀" in ax.get_xlabel()
    assert "hardness H₀" in ax.get_ylabel()
    [image] = [each for each in ax.collections if each.get_array() is not None][:1]
    assert 0.0 <= image.get_array().min() <= image.get_array().max() <= 1.0
    ax = Figure().subplots()
    three.plot_set("hardness", ax=ax, feasible_set=doubling)
    assert ax.get_ylabel() == "density over prior"
    assert ax.get_ylim()[0] == 0.0


def test_a_panel_of_no_searched_variable_is_refused(three, doubling):
    with pytest.raises(CampaignError) as refused:
        three.plot_set("hardnes", ax=Figure().subplots(), feasible_set=doubling)
    assert refused.value.problems[0].field == "hardnes"


def test_a_logarithmic_axis_has_no_two_labels_in_one_place():
    figure = Figure(figsize=(2.5, 2.0), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    ax = figure.subplots()
    ax.plot([12.0, 4e4], [2e-7, 3.0])
    ax.loglog()
    for axis in (ax.xaxis, ax.yaxis):
        log_ticks(axis)
    canvas.draw()
    renderer = canvas.get_renderer()
    for axis, side in ((ax.xaxis, 0), (ax.yaxis, 1)):
        low, high = sorted(axis.get_view_interval())
        ticks = zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=True)
        boxes = [label.get_window_extent(renderer) for at, label in ticks if low <= at <= high]
        ends = np.array([(box.min[side], box.max[side]) for box in boxes])
        assert len(ends) >= 2
        assert (ends[1:, 0] > ends[:-1, 1]).all()
        assert not any(label.get_text() for label in axis.get_minorticklabels())


def test_numbers_of_ticks_are_plain_or_powers_of_ten():
    numbers = (0.0, 0.05, 5000.0, 10000.0, 2e-5, 1e6)
    texts = [tick_text(number) for number in numbers]
    assert texts == ["0", "0.05", "5000", "10000", r"$2\times10^{-5}$", "$10^{6}$"]


def test_variables_are_named_with_their_symbols():
    labels = {each.name: variable_label(each, "1") for each in PAPER_VARIABLES}
    assert labels["hardness"] == "hardness H₀"
    assert labels["temperature"] == "temperature θ₀"
    assert labels["size_ratio"] == "size ratio l"
    path = Variable("restitution.viscosity", "Pa*s", "restitution.viscosity", "")
    assert variable_label(path, "Pa·s") == "restitution: viscosity (Pa·s)"


def test_a_number_of_samples_that_is_the_same_everywhere_has_no_histogram(finished, monkeypatch):
    data = read_campaign(finished)
    rows = data.result_rows().copy()
    rows["samples_used"] = 8
    monkeypatch.setattr(type(data), "result_rows", lambda _: rows)
    assert figures()["samples_per_string"].drawing(data, FigureOptions()) is None


def test_panels_of_a_row_have_letters(finished):
    axes = open_campaign(finished).plot_search_paths(figure=Figure(layout="constrained"))
    letters = [ax.get_title(loc="left")[:3] for ax in axes]
    assert letters[:2] == ["(a)", "(b)"]
