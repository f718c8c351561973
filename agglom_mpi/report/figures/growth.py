"""Growth over time: sizes of the best strings at the times of the data, and what was measured."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.data_fit import has_data, string_predictions
from agglom_mpi.analysis.shown_units import TIME, shown_unit
from agglom_mpi.formatting import axis_label
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.measurements.quantities import QUANTITIES, MeanLength, Quantile
from agglom_mpi.report.drawing import COLOURS, style_axes
from agglom_mpi.report.figures.data_fit import TWO_SIDED, compared_strings
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_campaign

Floats = NDArray[np.float64]

PANEL_SIZE: Final = (4.2, 3.2)
"""Width and height of a panel, inches."""
COLUMNS: Final = 2
"""Maximum number of panels side by side."""
LINE_STYLES: Final = [each.line_style for each in QUANTITIES.values() if each.share is not None]
"""Line styles of the quantiles."""

CLASSES_LABEL: Final = "classes with a measured quantile"


class GrowthCurve(NamedTuple):
    """A quantity of a string at all times.

    Attributes
    ----------
    string
        Name of the string.
    quantity
        A key of `QUANTITIES`.
    values, errors
        Values and their standard errors, shape (T,); nan at the start where it is not known.
    """

    string: str
    quantity: str
    values: Floats
    errors: Floats


class MeasuredPoint(NamedTuple):
    """A measured value with the ends of its 95 % interval; the value is nan if only they are known.

    Such is a quantile of a curve, which lies somewhere in a class.
    """

    quantity: str
    time: float
    value: float
    lower: float
    upper: float


class GrowthPanel(NamedTuple):
    """A panel: its axis label, curves and measurements, in the unit of the axis and in seconds."""

    label: str
    curves: list[GrowthCurve]
    points: list[MeasuredPoint]


class Growth(NamedTuple):
    """Content of a figure over time.

    Attributes
    ----------
    times
        The start and the times of the data, s, shape (T,).
    shown_time
        Factor and label of the unit of time on the axes.
    panels
    """

    times: Floats
    shown_time: tuple[float, str]
    panels: list[GrowthPanel]


def draw_growth(figure: Any, growth: Growth) -> NDArray[Any]:
    """Draw a panel for each kind of quantity, and return the axes, (panels,)."""
    columns, rows = _shape(len(growth.panels))
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for unused in axes[len(growth.panels) :]:
        unused.remove()
    axes = axes[: len(growth.panels)]
    factor, unit = growth.shown_time
    for place, (ax, panel) in enumerate(zip(axes, growth.panels, strict=True)):
        _draw_panel(ax, growth.times / factor, factor, panel)
        if place + columns >= len(axes):
            ax.set_xlabel(f"time ({unit})")
            ax.xaxis.set_tick_params(labelbottom=True)
    legend: dict[str, Any] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        legend |= dict(zip(labels, handles, strict=True))
    figure.legend(
        legend.values(), legend.keys(), loc="outside lower center", ncols=columns + 1, frameon=False
    )
    return np.asarray(axes)


def _draw_panel(ax: Any, times: Floats, factor: float, panel: GrowthPanel) -> None:
    """Draw the curves of a panel with their 95 % bands, and what was measured."""
    style_axes(ax)
    ax.set_ylabel(panel.label)
    colours: dict[str, str] = {}
    for curve in panel.curves:
        label = None if curve.string in colours else curve.string
        colour = colours.setdefault(curve.string, COLOURS[len(colours) % len(COLOURS)])
        line = {"color": colour, "marker": "o", "markersize": 2.5}
        above = 3.0 - 0.1 * len(colours)  # the best string lies above the others
        kind = QUANTITIES[curve.quantity]
        ax.plot(times, curve.values, kind.line_style, label=label, zorder=above, **line)
        half = TWO_SIDED * curve.errors
        low, high = curve.values - half, curve.values + half
        ax.fill_between(times, low, high, color=colour, alpha=0.2, linewidth=0)
        if kind.share is not None and len(colours) == 1:
            end = {"xytext": (12, 0), "textcoords": "offset points", "va": "center"}
            ax.annotate(curve.quantity, (times[-1], curve.values[-1]), fontsize="small", **end)
    for point in panel.points:
        _draw_point(ax, point, factor, 0.012 * float(times[-1]))
    ax.set_xlim(0.0, 1.1 * float(times[-1]))


def _draw_point(ax: Any, point: MeasuredPoint, factor: float, aside: float) -> None:
    """Draw a measured value with its error, or the classes that hold a quantile."""
    time = point.time / factor
    style = {"color": "0.15", "capsize": 3, "zorder": 4}
    if not math.isnan(point.value):
        bars = [[point.value - point.lower], [point.upper - point.value]]
        ax.errorbar(time, point.value, yerr=bars, fmt="o", markersize=5, label="measured", **style)
        return
    line_style = QUANTITIES[point.quantity].line_style
    time += aside * (LINE_STYLES.index(line_style) - 1)
    middle, half = 0.5 * (point.lower + point.upper), 0.5 * (point.upper - point.lower)
    found = ax.errorbar(time, middle, yerr=half, fmt="none", label=CLASSES_LABEL, **style)
    found.lines[2][0].set_linestyle(line_style)


def _shape(panels: int) -> tuple[int, int]:
    """Return columns and rows of panels."""
    columns = min(panels, COLUMNS)
    return columns, -(-panels // columns)


def quantile_bounds(curve: Datum, share: float) -> tuple[float, float] | None:
    """Return the edges of classes in m between which a quantile of a measured curve lies at 95 %.

    None where one of the two is open.
    """
    assert curve.edges is not None
    below = np.tril(np.ones((len(curve.values) - 1, len(curve.values))))
    shares = np.concatenate([[0.0], below @ curve.values, [1.0]])
    errors = np.sqrt(np.maximum(np.diag(below @ curve.covariance @ below.T), 0.0))
    half = TWO_SIDED * np.concatenate([[0.0], errors, [0.0]])
    low = float(curve.edges[shares + half < share].max(initial=0.0))
    high = float(curve.edges[shares - half > share].min(initial=math.inf))
    return (low, high) if low > 0.0 and math.isfinite(high) else None


class _Kind(NamedTuple):
    """Quantities of a panel, all by one weight."""

    label: str
    quantities: tuple[str, ...]
    weight: str


def _kinds(measured: Sequence[Datum]) -> list[_Kind]:
    """Return what the panels show: diameters by the weights of the data, and what else there is."""
    means = [datum.weight for datum in measured if datum.kind.panel == MeanLength.panel]
    quantiles = [
        datum.weight
        for datum in measured
        if datum.kind.panel == Quantile.panel or datum.kind.is_curve
    ]
    weights = {MeanLength.panel: means or quantiles, Quantile.panel: quantiles or means}
    kinds = [
        _Kind(panel.format(weight=each), _of_panel(panel), each)
        for panel, some in weights.items()
        for each in _once(some)
    ]
    others = (d.quantity for d in measured if not d.kind.panel and not d.kind.is_curve)
    return [*kinds, *(_Kind(each, (each,), "number") for each in _once(others))]


def _of_panel(panel: str) -> tuple[str, ...]:
    """Return the quantities that a panel shows; a radius is shown as a diameter."""
    return tuple(n for n, each in QUANTITIES.items() if each.panel == panel and not each.shown_as)


def _once(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))


def _growth(data: CampaignData, options: FigureOptions) -> Growth | None:
    """Return the growth of the best strings, or of one; None without data at several times."""
    if not has_data(data) or data.sizes.census is None or len(data.sizes.census.times) < 2:
        return None
    campaign = recorded_campaign(data)
    names = compared_strings(data, options.string)
    kinds = _kinds(campaign.data)
    curves = [_curves(data, string, name, kinds) for string, name in names.items()]
    known = [each for each in curves if each is not None]
    if not known:
        return None
    end = float(campaign.scene.end_time)  # data at several times need a fixed one
    times = np.array([0.0, *(min(time, end) for time in data.sizes.census.times)])
    panels = [
        _panel(data, kind, [each[place] for each in known], _points(kind, campaign.data, end))
        for place, kind in enumerate(kinds)
    ]
    return Growth(times, shown_unit(data.campaign_text, TIME, "s", float(times[-1])), panels)


def _curves(
    data: CampaignData, string: int, name: str, kinds: Sequence[_Kind]
) -> list[list[GrowthCurve]] | None:
    """Return the curves of a string in each panel, in SI units; None where no sample completed."""
    assert data.sizes.census is not None
    wanted = [(quantity, kind.weight) for kind in kinds for quantity in kind.quantities]
    times = [None if time == math.inf else time for time in data.sizes.census.times]
    asked = [
        Datum.of_value(quantity, 1.0, 1.0, weight, time)
        for quantity, weight in wanted
        for time in times
    ]
    found = string_predictions(data, string, asked)
    if found is None:
        return None
    shape = len(wanted), len(times)
    values = found.values.reshape(shape)
    errors = np.sqrt(np.diag(found.covariance)).reshape(shape)
    rows = iter(zip(wanted, values, errors, strict=True))
    curves: list[list[GrowthCurve]] = []
    for kind in kinds:
        curves.append([])
        for _ in kind.quantities:
            (quantity, _), own, error = next(rows)
            start = _start(data, string, quantity)
            curve = np.insert(own, 0, start), np.insert(error, 0, 0.0)
            curves[-1].append(GrowthCurve(name, quantity, *curve))
    return curves


def _start(data: CampaignData, string: int, quantity: str) -> float:
    """Return a quantity of the grains of a string in SI units; nan where their sizes differ."""
    kind, temperature = QUANTITIES[quantity], math.nan
    if kind.needs_heat:
        temperature = float(data.values([string], "temperature")[0])
    measured = recorded_campaign(data).measured_at(data.parameters[string])
    diameter = math.nan if "scene.sizes.law" in data.identity else measured.diameter
    return kind.at_start(measured.grains, diameter, temperature)


def _points(kind: _Kind, measured: Sequence[Datum], end: float) -> list[MeasuredPoint]:
    """Return what was measured of the quantities of a panel, in SI units."""
    points = []
    for datum in measured:
        time = end if datum.time is None else datum.time
        if datum.kind.has_weight and datum.weight != kind.weight:
            continue
        if datum.edges is not None:
            for quantity in kind.quantities:
                share = QUANTITIES[quantity].share
                bounds = None if share is None else quantile_bounds(datum, share)
                if bounds is not None:
                    points.append(MeasuredPoint(quantity, time, math.nan, *bounds))
            continue
        own = datum.kind
        if (quantity := own.shown_as or datum.quantity) in kind.quantities:
            value = float(datum.values[0]) / own.factor
            half = TWO_SIDED * math.sqrt(datum.covariance[0, 0]) / own.factor
            points.append(MeasuredPoint(quantity, time, value, value - half, value + half))
    return points


def _panel(
    data: CampaignData,
    kind: _Kind,
    curves: Sequence[Sequence[GrowthCurve]],
    points: Sequence[MeasuredPoint],
) -> GrowthPanel:
    """Return a panel in the unit of its axis."""
    own = [curve for each in curves for curve in each]
    largest = max(float(np.nanmax(curve.values)) for curve in own)
    name = kind.quantities[0]
    factor, unit = shown_unit(data.campaign_text, name, QUANTITIES[name].unit, largest)
    return GrowthPanel(
        axis_label(kind.label, unit),
        [c._replace(values=c.values / factor, errors=c.errors / factor) for c in own],
        [
            p._replace(value=p.value / factor, lower=p.lower / factor, upper=p.upper / factor)
            for p in points
        ],
    )


def _size(growth: Growth) -> tuple[float, float]:
    columns, rows = _shape(len(growth.panels))
    return PANEL_SIZE[0] * columns, PANEL_SIZE[1] * rows + 0.5


def _caption(growth: Growth) -> str:
    points = [point for panel in growth.panels for point in panel.points]
    ranges = any(math.isnan(point.value) for point in points)
    classes = " Bars without a point are the classes of a measured curve that hold a quantile."
    return (
        "The best strings at the start and at the times of the data, and measured numbers, with "
        f"95 % intervals.{classes if ranges else ''}"
    )


Figure(
    "growth",
    "answer",
    1,
    _growth,
    draw_growth,
    _caption,
    size=_size,
    empty="the campaign has no data at several times, or no string is judged yet",
    panels=True,
    method="plot_growth",
    meaning="Draw sizes of the best strings, or of one, over the times of the measured data.",
    takes=("string", "figure"),
)
