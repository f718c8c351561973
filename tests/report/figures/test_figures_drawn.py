"""Figures are drawn into the axes that are given, to scale, and say so when they are empty."""

from types import SimpleNamespace

import numpy as np
import pytest
from campaign_runs import SMALL, write_campaign
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from agglom_mpi.analysis.estimates import Estimate
from agglom_mpi.analysis.extrapolation import extrapolated
from agglom_mpi.analysis.finite_size import FiniteSize, VolumeMeans
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.report.figures import convergence
from agglom_mpi.report.figures.cloud import cloud_size, draw_frames, draw_radii
from agglom_mpi.report.figures.figure import FigureOptions, figures
from agglom_mpi.report.figures.fresh_estimates import draw_finalists, draw_finite_size
from agglom_mpi.report.sample_particles import RadiusDistribution
from agglom_mpi.report.style import Drawing, finish, legend_below, styled, write_drawing
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import prepare
from agglom_mpi.statistics import MeanEstimate
from agglom_mpi.storage.reader import read_campaign

PLOTS = ("convergence", "cost", "radii", "best", "ensembles", "finalists", "samples", "busy")


@pytest.mark.parametrize("name", PLOTS)
def test_a_plot_draws_into_the_axes_that_are_given_and_returns_them(finished, name):
    ax = Figure().subplots()
    assert getattr(open_campaign(finished), f"plot_{name}")(ax=ax) is ax
    assert ax.has_data()
    if name not in ("best",):
        assert ax.get_xlabel()


@pytest.mark.parametrize("name", ["cloud", "search_paths"])
def test_a_plot_of_panels_draws_into_the_figure_that_is_given(finished, name):
    figure = Figure(layout="constrained")
    panels = getattr(open_campaign(finished), f"plot_{name}")(figure=figure)
    assert all(ax.figure is figure for ax in panels)


def test_a_string_that_is_not_judged_is_refused_in_one_message(finished):
    with pytest.raises(ValueError, match="string is 99999, which is not judged"):
        open_campaign(finished).plot_radii(99999)


def test_without_matplotlib_a_plot_says_what_to_install(finished, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"pip install 'agglom_mpi\[report\]'"):
        open_campaign(finished).plot_busy(ax=object())


def drawn(place, radius, temperature=None):
    figure = Figure(figsize=cloud_size(1), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    frames = SimpleNamespace(
        times=np.zeros(1),
        particles=[len(radius)],
        positions=np.array([place]),
        radii=np.array([radius]),
        temperatures=np.array([temperature or [300.0] * len(radius)]),
    )
    [ax] = draw_frames(figure, frames, [0], 0.01)
    canvas.draw()
    [spheres] = [c for c in ax.collections if isinstance(c, EllipseCollection)]
    return ax, spheres


def test_spheres_are_circles_of_their_own_radius_to_scale():
    ax, spheres = drawn([[0.0, 0.0, 0.0], [0.004, 0.0, 0.0]], [0.001, 0.002])
    per_metre = ax.transData.transform([[1.0, 0.0]])[0, 0] - ax.transData.transform([[0, 0]])[0, 0]
    seen = [path.get_extents(transform) for path, transform in circles(spheres)]
    widths = [extent.width for extent in seen]
    np.testing.assert_allclose([extent.height for extent in seen], widths, rtol=1e-6)
    np.testing.assert_allclose(sorted(widths), [0.002 * per_metre, 0.004 * per_metre], rtol=0.01)


def circles(spheres):
    from matplotlib.transforms import Affine2D

    to_pixels = spheres.get_transform()
    return [(spheres.get_paths()[0], Affine2D(m) + to_pixels) for m in spheres.get_transforms()]


def test_spheres_in_front_are_drawn_last():
    _, spheres = drawn([[0.0, -0.009, 0.0], [0.0, 0.009, 0.0]], [0.001, 0.002])
    assert spheres.get_array().tolist() == [2.0, 1.0]  # the eye is at negative y


def test_particles_are_coloured_by_temperature_where_it_differs():
    _, spheres = drawn([[0.0] * 3, [0.005] * 3], [1e-3] * 2, temperature=[300.0, 400.0])
    assert sorted(spheres.get_array().tolist()) == [300.0, 400.0]
    _, same = drawn([[0.0] * 3, [0.005] * 3], [1e-3] * 2, temperature=[300.0, 300.0])
    assert same.get_array().tolist() == [1.0, 1.0]


@pytest.mark.parametrize(("tops", "labels"), [(1, []), (4, ["mean of the best 4"])])
def test_the_mean_of_the_best_is_drawn_if_it_is_of_several(tops, labels):
    ax, two = Figure().subplots(), np.array([0.2, 0.1])
    found = convergence.ConvergenceHistory(np.array([1, 2]), two, two, two, two, two, tops)
    convergence.draw_convergence(ax, found)
    assert ax.get_legend_handles_labels()[1] == ["best string, as searched", *labels]


def history(best, half, **more):
    """Return the search of a campaign whose best strings have these objectives and intervals."""
    best, half = np.array(best), np.array(half)
    generation = np.arange(1, len(best) + 1)
    return convergence.ConvergenceHistory(generation, best, best, half, best, half, 4, **more)


def band_ends(ax):
    """Return the lowest and the highest end of all bands and bars, in data units."""
    paths = [path for each in ax.collections for path in each.get_paths()]
    heights = np.concatenate([path.vertices[:, 1] for path in paths])
    return float(heights.min()), float(heights.max())


@pytest.mark.parametrize("best", [[0.2, 0.1], [0.2, 0.002], [0.2]])
def test_bands_of_an_objective_that_cannot_be_negative_end_at_zero(best):
    ax, fresh = Figure().subplots(), SimpleNamespace(objective=0.003, lower=0.0, upper=0.01)
    convergence.draw_convergence(ax, history(best, [0.5] * len(best), fresh=fresh))
    low, high = band_ends(ax)
    assert (low, high) == (0.0, pytest.approx(0.7))
    assert ax.get_ylim()[0] == 0.0
    # 0 is a place on the axis, not infinitely far below it.
    assert np.isfinite(ax.transData.transform([[1.0, 0.0]])).all()


def test_bands_far_above_zero_have_a_logarithmic_axis():
    ax = Figure().subplots()
    convergence.draw_convergence(ax, history([0.2, 0.002], [0.01, 0.0005]))
    assert ax.get_yscale() == "log"
    assert band_ends(ax)[0] == pytest.approx(0.0015)
    assert 0.0 < ax.get_ylim()[0] < 0.0015


def test_bands_of_an_objective_that_may_be_negative_are_whole():
    ax = Figure().subplots()
    convergence.draw_convergence(ax, history([0.2, 0.002], [0.5, 0.5], least=-np.inf))
    assert ax.get_yscale() == "linear"
    assert band_ends(ax)[0] == pytest.approx(-0.498)
    assert ax.get_ylim()[0] < -0.498


@pytest.mark.parametrize(("least", "low"), [(0.0, 0.0), (-np.inf, -0.3)])
def test_intervals_of_finalists_end_at_the_least_objective(least, low):
    estimate = Estimate(4, 0.1, 0.05, 0.0, 0.2, 10, 0, 2.0, 0.2, 0.25)
    ax = Figure().subplots()
    draw_finalists(ax, ([estimate], np.array([0.5]), "objective", least))
    searched, again = (each.get_paths()[0].vertices[:, 0] for each in ax.collections)
    assert searched.tolist() == pytest.approx([low, 0.7])
    assert again.tolist() == pytest.approx([0.0, 0.2])


def test_a_negative_objective_keeps_its_interval():
    estimate = Estimate(4, -2.1, 0.05, -2.2, -2.0, 10, 0, 2.0, -2.0, 0.25)
    ax = Figure().subplots()
    draw_finalists(ax, ([estimate], np.array([0.5]), "objective", -np.inf))
    searched = ax.collections[0].get_paths()[0].vertices[:, 0]
    assert searched.tolist() == pytest.approx([-2.5, -1.5])


def test_the_best_strings_are_marked_by_the_kind_of_their_objective(four_of_six):
    file, ax = open_campaign(four_of_six), Figure().subplots()
    file.plot_best(ax)
    best = file.best(6)
    lines = {line.get_label(): line for line in ax.lines if line.get_label().startswith("#")}
    for place, (_, row) in enumerate(best.iterrows(), 1):
        label = f"#{place} string {row['string']}: as searched {row['objective']:.4g}"
        known = not np.isnan(row["estimate"])
        if known:
            label += f", re-estimate {row['estimate']:.4g}"
        assert lines[label].get_linestyle() == ("-" if known else "--")


def test_re_estimates_stand_beside_means_that_include_other_samples(four_of_six):
    file, ax = open_campaign(four_of_six), Figure().subplots()
    file.plot_ensembles(ax)
    labels = ax.get_legend_handles_labels()[1]
    assert sum(label.startswith("re-estimates") for label in labels) == 1
    points = [line.get_ydata()[0] for line in ax.lines if line.get_marker() == "D"]
    assert set(file.estimates["objective"][:3]) <= set(points)


@pytest.fixture
def empty_data(tmp_path):
    """Return the rows of a campaign that has not begun."""
    write_campaign(tmp_path / "small.yaml", **SMALL)
    experiment = InversionExperiment(load_campaign(tmp_path / "small.yaml"))
    prepare(tmp_path / "small.h5", experiment, accept_code_change=False)
    return read_campaign(tmp_path / "small.h5")


@pytest.mark.parametrize("name", [name for name in figures() if name != "cloud"])
def test_an_empty_figure_says_why_and_is_not_on_the_page(empty_data, name):
    figure = figures()[name]
    assert figure.drawing(empty_data, FigureOptions()) is None
    target = Figure() if figure.panels else Figure().subplots()
    axes = np.ravel(figure.plot(empty_data, target, FigureOptions()))
    assert [text.get_text() for text in axes[0].texts] == [figure.empty]


def test_a_cloud_of_nothing_cannot_be_drawn(empty_data):
    with pytest.raises(ValueError, match="no string is judged yet"):
        figures()["cloud"].plot(empty_data, Figure(), FigureOptions())


def test_no_label_of_a_figure_is_clipped(finished):
    data, outside = read_campaign(finished), []
    shown = (f.drawing(data, FigureOptions()) for f in figures().values())
    drawn = [drawing for drawing in shown if drawing is not None]  # there are no larger volumes
    for drawing in drawn:
        with styled():
            figure = Figure(figsize=drawing.size, layout="constrained")
            canvas = FigureCanvasAgg(figure)
            finish(drawing.draw(figure))
            canvas.draw()
            found = figure.get_tightbbox(canvas.get_renderer())
        slack = 0.02  # inches, less than a letter's side
        if min(found.x0, found.y0) < -slack or np.any(
            np.array([found.x1, found.y1]) > np.array(drawing.size) + slack
        ):
            outside.append((drawing.name, found))
    assert len(drawn) == 10
    assert outside == []


def test_limits_are_drawn_where_1_over_n_is_0():
    volumes = tuple(
        VolumeMeans(v, 100 * v, 9, 0, 12.0, MeanEstimate(1.8 + 0.1 / v, 0.01, 9), None, 0.03, 1e-3)
        for v in (1, 2, 4)
    )
    fit = extrapolated([each.grains for each in volumes], [each.growth for each in volumes])
    ax = draw_finite_size(Figure().subplots(), [("#1 string 7", FiniteSize(7, volumes, fit, None))])
    [limit] = [line for line in ax.lines if line.get_marker() == "D"]
    assert limit.get_xdata()[0] == pytest.approx(0.0)
    assert limit.get_ydata()[0] == pytest.approx(1.8)


def test_a_figure_that_cannot_be_drawn_leaves_nothing(tmp_path):
    def fail(figure):
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        write_drawing(tmp_path, Drawing("bad", "", fail))
    assert list(tmp_path.iterdir()) == []


def test_radii_by_number_and_by_mass_each_add_up_to_all_particles():
    values = np.array([1.0, 1.0, 1.0, 2.0])
    ax = Figure().subplots()
    moments = (1.0, 0.1, 0.1)
    draw_radii(ax, RadiusDistribution(0, values, 1, False, 1.25, moments, "as stored"))
    bars, step = ax.patches[:-1], ax.patches[-1]
    heights = [bar.get_height() for bar in bars]
    assert (heights[0], heights[-1]) == (75.0, 25.0)
    assert step.get_xy()[:, 1].max() == pytest.approx(100.0 * 8.0 / 11.0)
    assert sum(heights) == pytest.approx(100.0)


def test_a_single_generation_has_a_tick_at_its_number_alone():
    ax = Figure().subplots()
    convergence.draw_convergence(ax, history([0.2], [0.1]))
    low, high = ax.get_xlim()
    assert [tick for tick in ax.get_xticks() if low <= tick <= high] == [1.0]


@pytest.mark.parametrize("height", [1.8, 3.8, 5.4])
def test_a_legend_below_overlaps_no_label_whatever_the_height(height):
    figure = Figure(figsize=(6.0, height), layout="constrained")
    canvas, ax = FigureCanvasAgg(figure), figure.subplots()
    ax.plot([0, 1], label="line")
    ax.set_xlabel("time (s)")
    legend_below(ax)
    canvas.draw()
    legend = ax.get_legend().get_window_extent(canvas.get_renderer())
    assert not legend.overlaps(ax.xaxis.label.get_window_extent(canvas.get_renderer()))
