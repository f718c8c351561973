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
from agglom_mpi.measurements.layout import CensusLayout
from agglom_mpi.measurements.quantities import QUANTITIES, MeanLength, Quantile
from agglom_mpi.report.figures.data_fit import TWO_SIDED, compared_strings
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.report.style import COLOURS, draw_band, figure_legend, panels
from agglom_mpi.search.objectives.misfit import MeasuredString
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_campaign

Floats = NDArray[np.float64]

PANEL_SIZE: Final = (3.5, 2.6)
"""Width and height of a panel, inches."""
COLUMNS: Final = 2
"""Maximum number of panels side by side."""
LINE_STYLES: Final = [each.line_style for each in QUANTITIES.values() if each.share is not None]
"""Line styles of the quantiles."""

CLASSES_LABEL: Final = "classes with a measured quantile"


class GrowthPanel(NamedTuple):
    """A panel of quantities by one weight, in SI units.

    Attributes
    ----------
    label
        Axis label.
    factor
        The unit of the axis in SI units.
    curves
        Name of a string, a key of `QUANTITIES`, and values with their standard errors at all times,
        shape (T,); nan at the start where it is not known.
    points
        Quantity, time in s, measured value, and the ends of its 95 % interval; the value is nan if
        only they are known: a quantile of a curve lies somewhere in a class.
    """

    label: str
    factor: float
    curves: list[tuple[str, str, Floats, Floats]]
    points: list[tuple[str, float, float, float, float]]


Growth = tuple[Floats, tuple[float, str], list[GrowthPanel]]
"""The start and the times of the data, (T,), in s, factor and label of the unit of time on the
axes, and panels."""


def draw_growth(figure: Any, growth: Growth) -> NDArray[Any]:
    """Draw a panel for each kind of quantity, and return the axes, (panels,)."""
    times, (factor, unit), shown = growth
    axes = panels(figure, len(shown), COLUMNS, f"time ({unit})")
    for ax, panel in zip(axes, shown, strict=True):
        _draw_panel(ax, times / factor, factor, panel)
    figure_legend(figure, axes, min(len(axes), COLUMNS) + 1)
    return np.asarray(axes)


def _draw_panel(ax: Any, times: Floats, factor: float, panel: GrowthPanel) -> None:
    ax.set_ylabel(panel.label)
    colours: dict[str, str] = {}
    for string, quantity, *curve in panel.curves:
        label = None if string in colours else string
        colour = colours.setdefault(string, COLOURS[len(colours) % len(COLOURS)])
        values, errors = (each / panel.factor for each in curve)
        kind, half = QUANTITIES[quantity], TWO_SIDED * errors
        line = {"marker": "o", "markersize": 2.5, "linestyle": kind.line_style, "label": label}
        line["zorder"] = 3.0 - 0.1 * len(colours)  # the best string lies above the others
        draw_band(ax, times, values, (values - half, values + half), colour, **line)
        if kind.share is not None and len(colours) == 1:
            end = {"xytext": (12, 0), "textcoords": "offset points", "va": "center"}
            ax.annotate(quantity, (times[-1], values[-1]), **end)
    for quantity, time, *interval in panel.points:
        ends = np.array(interval) / panel.factor
        _draw_point(ax, quantity, time / factor, ends, 0.012 * float(times[-1]))
    ax.set_xlim(0.0, 1.1 * float(times[-1]))


def _draw_point(ax: Any, quantity: str, time: float, interval: Floats, aside: float) -> None:
    """Draw a measured value with its error, or the classes that hold a quantile."""
    value, lower, upper = interval
    style = {"color": "0.15", "capsize": 3, "zorder": 4}
    if not math.isnan(value):
        bars = [[value - lower], [upper - value]]
        ax.errorbar(time, value, yerr=bars, fmt="o", markersize=5, label="measured", **style)
        return
    line_style = QUANTITIES[quantity].line_style
    time += aside * (LINE_STYLES.index(line_style) - 1)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    found = ax.errorbar(time, middle, yerr=half, fmt="none", label=CLASSES_LABEL, **style)
    found.lines[2][0].set_linestyle(line_style)


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


_Kind = tuple[str, tuple[str, ...], str]
"""Label of a panel, its quantities, and the weight of all of them."""


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
        (panel.format(weight=each), _of_panel(panel), each)
        for panel, some in weights.items()
        for each in _once(some)
    ]
    others = (d.quantity for d in measured if not d.kind.panel and not d.kind.has_file)
    return [*kinds, *((each, (each,), "number") for each in _once(others))]


def _of_panel(panel: str) -> tuple[str, ...]:
    """Return the quantities that a panel shows; a radius is shown as a diameter."""
    return tuple(n for n, each in QUANTITIES.items() if each.panel == panel and not each.shown_as)


def _once(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))


def _growth(data: CampaignData, options: FigureOptions) -> Growth | None:
    """Return the growth of the best strings, or of one; None without data at several times."""
    layout = data.sizes.census
    if not has_data(data) or not isinstance(layout, CensusLayout) or len(layout.times) < 2:
        return None
    campaign = recorded_campaign(data)
    names = compared_strings(data, options.string)
    kinds = _kinds(campaign.data)
    wanted = [(quantity, weight) for _, some, weight in kinds for quantity in some]
    curves = [_curves(data, string, wanted) for string in names]
    known = [(name, own) for name, own in zip(names.values(), curves, strict=True) if own]
    if not known:
        return None
    end = float(campaign.scene.end_time)  # data at several times need a fixed one
    times = np.array([0.0, *(min(time, end) for time in layout.times)])
    shown_panels = []
    for kind in kinds:
        label, quantities, weight = kind
        shown = [(name, q, *own[q, weight]) for name, own in known for q in quantities]
        largest, name = max(float(np.nanmax(curve[2])) for curve in shown), quantities[0]
        factor, unit = shown_unit(data.campaign_text, name, QUANTITIES[name].unit, largest)
        points = _points(kind, campaign.data, end)
        shown_panels.append(GrowthPanel(axis_label(label, unit), factor, shown, points))
    unit_of_time = shown_unit(data.campaign_text, TIME, "s", float(times[-1]))
    return times, unit_of_time, shown_panels


def _curves(
    data: CampaignData, string: int, wanted: Sequence[tuple[str, str]]
) -> dict[tuple[str, str], tuple[Floats, Floats]]:
    """Return the values of a string and their errors, in SI units, by quantity and weight.

    Empty where no sample completed.
    """
    layout = data.sizes.census
    assert isinstance(layout, CensusLayout)
    times = [None if time == math.inf else time for time in layout.times]
    asked = [
        Datum.of_value(quantity, 1.0, 1.0, weight, time)
        for quantity, weight in wanted
        for time in times
    ]
    found = string_predictions(data, string, asked)
    if found is None:
        return {}
    shape = len(wanted), len(times)
    values, errors = found[1].reshape(shape), np.sqrt(np.diag(found[2])).reshape(shape)
    return {
        each: (np.insert(own, 0, _start(data, string, each[0])), np.insert(error, 0, 0.0))
        for each, own, error in zip(wanted, values, errors, strict=True)
    }


def _start(data: CampaignData, string: int, quantity: str) -> float:
    """Return a quantity of the grains of a string in SI units; nan where their sizes differ."""
    kind, temperature = QUANTITIES[quantity], math.nan
    if kind.needs_heat:
        temperature = float(data.values([string], "temperature")[0])
    measured = recorded_campaign(data).measured_at(data.parameters[string])
    assert isinstance(measured, MeasuredString)
    diameter = math.nan if "scene.sizes.law" in data.identity else measured.diameter
    return kind.at_start(measured.grains, diameter, temperature)


def _points(
    kind: _Kind, measured: Sequence[Datum], end: float
) -> list[tuple[str, float, float, float, float]]:
    points = []
    _, quantities, weight = kind
    for datum in measured:
        time, own = end if datum.time is None else datum.time, datum.kind
        if own.has_weight and datum.weight != weight:
            continue
        if datum.edges is not None:
            for quantity in quantities:
                share = QUANTITIES[quantity].share
                bounds = None if share is None else quantile_bounds(datum, share)
                if bounds is not None:
                    points.append((quantity, time, math.nan, *bounds))
        elif (quantity := own.shown_as or datum.quantity) in quantities:
            value = float(datum.values[0]) / own.factor
            half = TWO_SIDED * math.sqrt(datum.covariance[0, 0]) / own.factor
            points.append((quantity, time, value, value - half, value + half))
    return points


def _size(growth: Growth) -> tuple[float, float]:
    count = len(growth[2])
    rows = -(-count // COLUMNS)
    return PANEL_SIZE[0] * min(count, COLUMNS), PANEL_SIZE[1] * rows + 0.5


def _caption(growth: Growth) -> str:
    ranges = any(math.isnan(point[2]) for panel in growth[2] for point in panel.points)
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
