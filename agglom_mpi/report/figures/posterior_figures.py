"""The posterior of a campaign with data: its variables, what it predicts, what to measure next."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.shown_units import unit_of_datum, unit_of_variable
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.declaration.units import to_si
from agglom_mpi.formatting import in_unit
from agglom_mpi.report.figures.box_panels import (
    MAX_PLOTTED_VARIABLES,
    BoxPoints,
    corner_legend,
    corner_size,
    draw_corner,
    draw_field,
    draw_marginal,
    draw_regions,
    pair_edges,
    region_handles,
)
from agglom_mpi.report.figures.data_fit import (
    TWO_SIDED,
    ComparedDatum,
    Prediction,
    data_fit_size,
    draw_data_fit,
)
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.report.style import COLOURS, PAGE, legend_below
from agglom_mpi.statistics import gap_between, weighted_quantiles
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import matplotlib.figure

    from agglom_mpi.inference.next_measurement import NextMeasurements
    from agglom_mpi.inference.posterior import Posterior
    from agglom_mpi.inference.searched_box import SearchedBox


Floats = NDArray[np.float64]

DENSITY_CELLS: Final = 100
"""Number of cells of the density of a pair along each side of its panel."""
TAIL: Final = 1e-3
"""Share of the posterior beyond each end of a variable's range, before its margin."""
RANGE_MARGIN: Final = 0.1
"""Margin of the range of a panel, relative to its width."""
CENTRAL: Final = (0.05, 0.5, 0.95)
"""Quantiles of a variable above its marginal."""
WARNING_COLOUR: Final = COLOURS[1]
TRUTH_COLOUR: Final = COLOURS[6]


def posterior_points(posterior: "Posterior") -> BoxPoints:
    """Return the strings of a posterior as weighted points, the narrowest variables first."""
    box, weights = posterior.of.box, posterior.weights
    names = sorted(box.names, key=lambda name: posterior.contraction[name])
    units = box.space.to_unit(posterior.strings)
    ends = [weighted_quantiles(column, weights, (TAIL, 1.0 - TAIL)) for column in units.T]
    low, high = np.array(ends).T
    margin = RANGE_MARGIN * (high - low)
    lower, upper = np.maximum(low - margin, 0.0), np.minimum(high + margin, 1.0)
    return BoxPoints(box, names, units, weights, lower, upper)


ShownPosterior = tuple["Posterior", BoxPoints, Mapping[str, float]]
"""A posterior with points to draw it by, and true values of variables in SI units, by name."""


def shown_posterior(
    posterior: "Posterior | None", truth: Mapping[str, float | str] | None
) -> ShownPosterior | None:
    """Return a posterior to be drawn, whatever was measured.

    Raises
    ------
    CampaignError
        If `truth` names no searched variable, or its value has another unit.
    """
    if posterior is None:
        return None
    points = posterior_points(posterior)
    known = {name: _true_value(points.box, name, value) for name, value in (truth or {}).items()}
    return posterior, points, known


def _caption(shown: ShownPosterior) -> str:
    posterior, points, _ = shown
    left = len(points.names) - MAX_PLOTTED_VARIABLES
    more = f" The {left} that are narrowed down least are left out." if left > 0 else ""
    return (
        f"Posterior of the variables, given {posterior.given}: densities of pairs, regions with "
        "50 % and 90 % of it, and marginals over the prior (line at 1) with median and central "
        f"90 %.{more}{_doubt(posterior)}"
    )


def _doubt(posterior: "Posterior") -> str:
    return f" Unreliable: {posterior.warning}." if posterior.warning else ""


def _true_value(box: "SearchedBox", name: str, value: float | str) -> float:
    """Return a value of a searched variable, given as a number or a text, in its SI unit."""
    if name not in box.names:
        raise box.mistaken(name, f"is no searched variable; {suggestion(name, box.names)}")
    try:
        return to_si(value, box.own[box.names.index(name)].unit)
    except ValueError as error:
        raise box.mistaken(name, error) from None


def draw_posterior(figure: "matplotlib.figure.Figure", shown: ShownPosterior) -> Any:
    """Draw the corner plot of a posterior, and return the axes, shape (m, m)."""
    posterior, points, known = shown

    def draw_one(ax: Any, name: str) -> None:
        draw_marginal(ax, points, name, COLOURS[0])
        ax.set_title(_range_text(points, posterior, name), pad=3)
        if name in known:
            [at] = points.coordinates(name, [known[name]])
            ax.axvline(at, color=TRUTH_COLOUR, linewidth=1.2)

    def draw_two(ax: Any, column: str, row: str) -> None:
        _draw_pair(ax, points, column, row)
        places = [
            points.coordinates(each, [known[each]]) for each in (column, row) if each in known
        ]
        if len(places) == 2:
            ax.plot(*places, "+", color=TRUTH_COLOUR, markersize=8, markeredgewidth=1.6)

    axes = draw_corner(figure, points, draw_one, draw_two)
    if len(points.names) > 1:
        handles = region_handles("posterior")
        if known:
            handles.append(_truth_handle())
        corner_legend(figure, handles)
    _warn(figure, posterior.warning)
    return axes


def _range_text(points: BoxPoints, posterior: "Posterior", name: str) -> str:
    """Return the median of a variable and, below it, its central 90 %, in its unit."""
    factor, unit = unit_of_variable(points.box.campaign.text, points.variable(name))
    low, median, high = (value / factor for value in posterior.quantiles(name, CENTRAL))
    return f"{in_unit(f'{median:.3g}', unit)}\n90 %: {in_unit(f'{low:.3g} to {high:.3g}', unit)}"


def _draw_pair(ax: Any, points: BoxPoints, column: str, row: str) -> None:
    """Draw the density of a pair of variables, and the smallest regions with given shares of it."""
    edges = pair_edges(points, column, row, DENSITY_CELLS)
    density = pair_density(points.column(column), points.column(row), points.weights, edges)
    draw_field(ax, edges, density, float(density.max()))
    draw_regions(ax, edges, density)


def pair_density(x: Floats, y: Floats, weights: Floats, edges: Sequence[Floats]) -> Floats:
    """Return the density of weighted points, (n,), in the cells of a panel, by normal kernels.

    Kernels have the shape of the points' covariance, of groups that are apart within these, so that
    a narrow ridge stays narrow, and the width of Scott's rule, n^(-1/6) by the effective n, but at
    least half a cell. The result is over that of a uniform density, so that it does not fall
    towards an edge of the box.
    """
    from scipy.signal import fftconvolve

    mass = np.histogram2d(x, y, bins=edges, weights=weights)[0]
    cells = np.array([edge[1] - edge[0] for edge in edges])
    size = np.sum(weights) ** 2 / np.sum(weights**2)
    covariance = _covariance_within(np.array([x, y]), weights) * size ** (-1.0 / 3.0)
    precision = np.linalg.inv(covariance + np.diag((0.5 * cells) ** 2))
    reach = np.arange(1 - len(mass), len(mass))
    away = np.stack(np.meshgrid(reach * cells[0], reach * cells[1], indexing="ij"), axis=-1)
    kernel = np.exp(-0.5 * np.einsum("ijk,kl,ijl->ij", away, precision, away))
    inside = fftconvolve(np.ones(mass.shape), kernel, mode="same")
    density = np.maximum(fftconvolve(mass, kernel, mode="same"), 0.0) / inside
    return np.asarray(density / density.sum())


def _covariance_within(points: Floats, weights: Floats) -> Floats:
    """Return the mean covariance, (2, 2), of the groups that weighted points, (2, n), lie in."""
    centre = np.average(points, axis=1, weights=weights)
    away = points - centre[:, None]
    covariance = (weights * away) @ away.T / weights.sum()
    along = np.linalg.eigh(covariance)[1][:, -1] @ away
    gap = gap_between(along, weights)
    parts = [] if gap is None else [along < gap, along >= gap]
    if not all(weights[part].any() for part in parts) or not parts:
        return np.asarray(covariance)
    of_parts = [_covariance_within(points[:, part], weights[part]) for part in parts]
    return np.average(of_parts, axis=0, weights=[weights[part].sum() for part in parts])


def _truth_handle() -> Any:
    from matplotlib.lines import Line2D

    handle = Line2D([], [], color=TRUTH_COLOUR, label="truth", linestyle="none")
    handle.set(marker="+", markersize=8, markeredgewidth=1.6)
    return handle


Predicted = tuple[list[ComparedDatum], "Posterior"]
"""All data with what a posterior predicts for them."""


def predicted_data(data: CampaignData, options: FigureOptions) -> Predicted | None:
    """Return all data with what the strings of a posterior predict for them."""
    if options.posterior is None:
        return None
    found = []
    for each in options.posterior.predictions:
        shown = unit_of_datum(data.campaign_text, each.datum)
        note = ", ".join(filter(None, (f"p = {each.p_value:.2g}", each.verdict)))
        found.append(ComparedDatum(each.datum, [Prediction("posterior", each.draws)], shown, note))
    return found, options.posterior


def draw_predictive(figure: "matplotlib.figure.Figure", predicted: Predicted) -> NDArray[Any]:
    """Draw data beside the predictions of a posterior, and return the axes, (panels,)."""
    compared, posterior = predicted
    axes = draw_data_fit(figure, compared)
    _warn(figure, posterior.warning)
    return axes


def _warn(figure: "matplotlib.figure.Figure", warning: str) -> None:
    """Write above a figure why a posterior is unreliable, if it is."""
    if warning:
        text = textwrap.fill(f"unreliable: {warning}", max(40, int(11 * figure.get_figwidth())))
        figure.suptitle(text, color=WARNING_COLOUR)


Figure(
    "set_posterior",
    "set",
    9,
    lambda _, options: shown_posterior(options.mean_posterior, None),
    draw_posterior,
    _caption,
    lambda shown: corner_size(len(shown[1].names)),
    panels=True,
)
Figure(
    "posterior_pairs",
    "posterior",
    0,
    lambda _, options: shown_posterior(options.posterior, options.truth),
    draw_posterior,
    _caption,
    lambda shown: corner_size(len(shown[1].names)),
    panels=True,
    method="plot_posterior",
    meaning="Draw the posterior given all measured data as a corner plot; takes some ten seconds. "
    "`truth` marks values of variables; `posterior` is what `posterior()` returned.",
    takes=("truth", "figure", "posterior"),
)
Figure(
    "predictive_check",
    "posterior",
    1,
    predicted_data,
    draw_predictive,
    lambda predicted: (
        "Data beside what the posterior predicts, with 95 % intervals; p is the probability that "
        "a further measurement would differ more, near 0 where a datum disagrees with the model."
        f"{_doubt(predicted[1])}"
    ),
    lambda predicted: data_fit_size(predicted[0]),
    panels=True,
    method="plot_predictive",
    meaning="Draw all measured data beside what the posterior predicts for them.",
    takes=("figure", "posterior"),
)


MAX_BARS: Final = 20
"""Maximum number of measurements that are drawn."""
BAR_HEIGHT: Final = 0.24
"""Height of the figure per bar, inches."""


def draw_next(ax: Any, found: "NextMeasurements") -> Any:
    """Draw the expected volume after each measurement beside that of today; return the axes."""
    shown = found.ranked[:MAX_BARS]
    place = np.arange(len(shown))
    volumes = 100.0 * np.array([each.after.value for each in shown])
    errors = 100.0 * TWO_SIDED * np.array([each.after.error for each in shown])
    for repeats, colour, label in (
        (False, COLOURS[0], "new quantity"),
        (True, COLOURS[4], "repetition with half of the error"),
    ):
        some = np.array([each.repeats is repeats for each in shown], bool)
        if some.any():
            ax.barh(place[some], volumes[some], color=colour, height=0.7, label=label)
    ax.errorbar(volumes, place, xerr=errors, fmt="none", ecolor="0.15", capsize=2)
    ax.axvline(100.0 * found.volume, color="0.3", linestyle="--", label="posterior as it is")
    names = [each.name if each.repeats else f"{each.name}, {each.error_text}" for each in shown]
    ax.set_yticks(place, names)
    ax.set_ylim(len(shown) - 0.4, -0.6)
    ax.set_xlabel("expected share of the box (%)")
    legend_below(ax)
    return ax


def _found(_: CampaignData, options: FigureOptions) -> "NextMeasurements | None":
    if options.plotted and options.posterior is not None:
        return options.posterior.next_measurements()
    return options.further


def _next_caption(found: "NextMeasurements") -> str:
    left = len(found.ranked) - MAX_BARS
    more = f" The {left} that would leave more are left out." if left > 0 else ""
    return (
        "What to measure next: expected share of the box in the smallest region with 90 % of the "
        "posterior after one more measurement, with 95 % intervals of the simulated measurements."
        f"{more}"
    )


Figure(
    "next_measurement",
    "posterior",
    2,
    _found,
    draw_next,
    _next_caption,
    lambda found: (PAGE, 1.5 + BAR_HEIGHT * min(len(found.ranked), MAX_BARS)),
    method="plot_next_measurement",
    meaning="Draw what each further measurement would leave of the box; takes a minute.",
    takes=("ax", "posterior"),
)
