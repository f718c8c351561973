"""Figures of a posterior: regions of pairs, units and marks, and predictions beside the data."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from measured_samples import counted_covariance
from scipy.stats import chi2

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.statistics import weighted_quantiles

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

from agglom_mpi.report.figures.box_panels import region_level
from agglom_mpi.report.figures.data_fit import Prediction
from agglom_mpi.report.figures.figure import FigureOptions, figures
from agglom_mpi.report.figures.posterior_figures import pair_density

MEASURED = Path(__file__).parents[3] / "jobs" / "measured" / "measured.yaml"
SHARES = np.array([0.3, 0.5, 0.2])
CURVE = Datum(
    "sizes",
    SHARES,
    counted_covariance(SHARES, 400),
    edges=np.array([0.0, 1e-3, 2e-3, np.inf]),
    name="sizes by number at the end",
)
EDGES = [np.linspace(0.0, 1.0, 41)] * 2
HEAT = Datum.of_value("temperature", 300.26, 0.01, name="temperature at the end")


@pytest.fixture(scope="module")
def campaign():
    return load_campaign(MEASURED)


@pytest.fixture
def data(campaign):
    found = SimpleNamespace(campaign_text=campaign.text, path="run.h5")
    found.derived = lambda compute: compute(found)
    return found


@pytest.fixture
def posterior(campaign):
    """Return strings with normal weights in the middle of the box, and predictions of two data."""
    box = SearchedBox(campaign)
    strings = box.even_strings(1 << 11)
    weights = np.exp(-0.5 * np.sum(((box.space.to_unit(strings) - 0.5) / 0.1) ** 2, axis=1))
    weights /= weights.sum()
    columns = {each.name: each.values(strings) for each in box.own}
    random = np.random.default_rng(3)
    draws = [
        SHARES + 0.01 * random.normal(size=(50, 3)),
        300.25 + 0.01 * random.normal(size=(50, 1)),
    ]
    predictions = [
        SimpleNamespace(datum=datum, draws=each, p_value=p, verdict="disagrees" * (p < 0.05))
        for datum, each, p in zip((CURVE, HEAT), draws, (0.4, 0.01), strict=True)
    ]
    return SimpleNamespace(
        of=SimpleNamespace(box=box),
        strings=strings,
        weights=weights,
        contraction=dict(zip(box.names, (0.3, 0.1, 0.2), strict=True)),
        quantiles=lambda name, shares: weighted_quantiles(columns[name], weights, shares),
        predictions=predictions,
        given="all 2 measured data",
        warning="",
    )


def test_the_regions_of_a_normal_density_have_their_shares():
    side = np.linspace(-5.0, 5.0, 401)
    squares = side[:, None] ** 2 + side**2
    level = region_level(np.exp(-0.5 * squares), 0.9)
    assert -2.0 * np.log(level) == pytest.approx(chi2.ppf(0.9, 2), rel=0.01)


def test_the_density_of_a_narrow_ridge_is_narrow_and_whole():
    x = np.linspace(0.0, 1.0, 500)
    edges = [np.linspace(0.0, 1.0, 101)] * 2
    density = pair_density(x, x, np.full(500, 0.002), edges)
    assert density.sum() == pytest.approx(1.0)
    places = np.arange(100)
    near = np.abs(places[:, None] - places) <= 3
    assert density[near].sum() > 0.99
    along = density.sum(axis=0)
    assert along[:10].sum() == pytest.approx(0.1, abs=0.02)  # nothing is lost at the ends


def test_the_density_of_even_points_is_even_up_to_the_edges():
    side = (np.arange(40) + 0.5) / 40
    x, y = (each.ravel() for each in np.meshgrid(side, side))
    density = pair_density(x, y, np.ones(1600), [np.linspace(0.0, 1.0, 41)] * 2)
    assert 1600 * density == pytest.approx(np.ones((40, 40)), rel=0.1)


def test_each_of_two_groups_far_apart_is_as_narrow_as_alone():
    rng, edges = np.random.default_rng(1), [np.linspace(0.0, 1.0, 101)] * 2
    x = np.concatenate([rng.normal(0.2, 0.01, 1000), rng.normal(0.8, 0.03, 1000)])
    y = rng.uniform(0.0, 1.0, 2000)
    density = pair_density(x, y, np.ones(2000), edges).sum(axis=1)
    assert density[15:25].sum() > 0.48
    assert density[30:60].sum() < 0.01


def test_points_count_by_their_weights_in_a_density():
    x, y = np.array([0.25, 0.75, 0.25, 0.75]), np.array([0.25, 0.75, 0.75, 0.25])
    weights = np.array([0.4, 0.1, 0.3, 0.2])
    density = pair_density(np.tile(x, 500), np.tile(y, 500), np.tile(weights, 500) / 500, EDGES)
    mirrored = pair_density(np.tile(y, 500), np.tile(x, 500), np.tile(weights, 500) / 500, EDGES)
    assert density == pytest.approx(mirrored.T)
    assert density[:20].sum() == pytest.approx(0.7, abs=0.02)
    assert density[:, :20].sum() == pytest.approx(0.6, abs=0.02)


def plotted(name, data, posterior, truth=None):
    options = FigureOptions(posterior=posterior, truth=truth)
    return figures()[name].plot(data, Figure(), options)


def drawings_of(data, posterior):
    options = FigureOptions(posterior=posterior)
    names = ("posterior_pairs", "predictive_check")
    return [figures()[name].drawing(data, options) for name in names]


def test_a_corner_plot_has_the_narrowest_variable_first_in_the_units_of_the_campaign(
    data, posterior
):
    axes = plotted("posterior_pairs", data, posterior, {})
    assert axes.shape == (3, 3)
    names = [ax.get_xlabel() for ax in axes[-1]]
    assert names == ["hardness H₀ (MPa)", "heat capacity C (J/kg/K)", "relative speed v₀ (m/s)"]
    assert axes[0, 0].get_title().endswith("MPa")
    median = float(axes[0, 0].get_title().split()[0])
    assert median == pytest.approx(np.sqrt(10.0 * 200.0), rel=0.05)  # the middle of the box


def test_a_true_value_is_marked_where_it_is(data, posterior):
    truth = {"hardness": "60 MPa", "relative_speed": 50.0}
    axes = plotted("posterior_pairs", data, posterior, truth)
    place = np.log(60.0 / 10.0) / np.log(200.0 / 10.0)
    assert axes[0, 0].lines[-1].get_xdata()[0] == pytest.approx(place)
    assert len(axes[1, 1].lines) == 1  # the prior alone
    [mark] = axes[2, 0].lines
    assert mark.get_xdata()[0] == pytest.approx(place)
    assert mark.get_ydata()[0] == pytest.approx(np.log(5.0) / np.log(10.0))


@pytest.mark.parametrize("truth", [{"hardnes": 1e7}, {"hardness": "60 K"}, {"density": 5000.0}])
def test_a_true_value_of_no_searched_variable_is_refused(data, posterior, truth):
    with pytest.raises(CampaignError) as refused:
        plotted("posterior_pairs", data, posterior, truth)
    [problem] = refused.value.problems
    assert problem.field == next(iter(truth))


def test_intervals_of_draws_are_their_quantiles():
    draws = np.linspace(0.0, 1.0, 1001)[:, None] * np.array([1.0, 2.0])
    found = Prediction("posterior", draws).interval(np.array([[1.0, 1.0], [0.0, 1.0]]))
    middle, low, high = found
    assert middle == pytest.approx([1.5, 1.0])
    assert low == pytest.approx([0.075, 0.05])
    assert high == pytest.approx([2.925, 1.95])


def test_predictions_stand_beside_all_data_with_their_p_values(data, posterior):
    axes = plotted("predictive_check", data, posterior)
    assert len(axes) == 3
    assert [text.get_text() for text in axes[0].texts] == ["p = 0.4"]
    [label] = axes[2].get_yticklabels()
    assert label.get_text().endswith("K, p = 0.01, disagrees")


@pytest.mark.parametrize("warning", ["", "the ranges are too narrow"])
def test_figures_of_an_unreliable_posterior_say_so(data, posterior, warning):
    posterior.warning = warning
    drawings = drawings_of(data, posterior)
    assert [drawing.name for drawing in drawings] == ["posterior_pairs", "predictive_check"]
    for drawing in drawings:
        figure = Figure(figsize=drawing.size)
        drawing.draw(figure)
        assert (warning in drawing.caption) is True
        assert figure.get_suptitle() == (f"unreliable: {warning}" if warning else "")
        assert ("nreliable" in drawing.caption) is bool(warning)


def test_figures_of_a_posterior_are_drawn_without_warnings(data, posterior, recwarn):
    for drawing in drawings_of(data, posterior):
        figure = Figure(figsize=drawing.size, layout="constrained")
        drawing.draw(figure)
        figure.canvas.draw()
    drawn = [each for each in recwarn if not issubclass(each.category, ResourceWarning)]
    assert [str(each.message) for each in drawn] == []
