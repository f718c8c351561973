"""Where the search went: variables against generation, the best strings, sensitivities."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.derived import derived_columns, searched_variables, values_of
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.shown_units import unit_of_variable
from agglom_mpi.formatting import label_of
from agglom_mpi.report.figures.figure import Figure, FigureOptions
from agglom_mpi.report.style import (
    COLOURS,
    MIDDLE,
    PAGE,
    STRING_LINK,
    few_ticks,
    figure_legend,
    integer_ticks,
    legend_below,
    panels,
    tick_text,
    variable_label,
)
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.variables import Variable

if TYPE_CHECKING:
    import matplotlib.figure

    from agglom_mpi.analysis.sensitivity import Sensitivity

Floats = NDArray[np.float64]

DERIVED: Final = "a derived quantity"
"""Meaning of what is shown beside the variables."""
PANEL_SIZE: Final = (2.4, 1.8)
"""Width and height of a panel of the search paths, inches."""
MAX_MARKED: Final = 30
"""Minimum number of generations for a line without marks at single ones."""
BEST: Final = 6
"""Strings in colour in the figure of the best strings."""
OTHERS: Final = 40
"""Strings that follow in grey."""
MAX_HORIZONTAL: Final = 5
"""Variables whose names have room side by side."""


class VariablePath(NamedTuple):
    """Values of one variable over G generations and n strings, in SI units.

    Attributes
    ----------
    variable
        With the range that is searched.
    best
        Value of the best string after each generation, shape (G,).
    least, most
        Range of the best strings after each generation, shape (G,).
    evaluated, generation
        Values of all strings with a result, and the generation of each, from 1, shape (n,).
    strings
        Their numbers, shape (n,).
    shown_unit
        Factor and label of the unit on the axis.
    """

    variable: Variable
    best: Floats
    least: Floats
    most: Floats
    evaluated: Floats
    generation: Floats
    strings: NDArray[np.int64]
    shown_unit: tuple[float, str]


def shown_variables(data: CampaignData) -> list[Variable]:
    """Return the variables that are searched, and derived quantities over the range they took."""
    evaluated = np.isin(data.string_rows()["string"], data.result_rows()["string"])
    shown = list(searched_variables(data))
    for column in derived_columns(data):
        values = column.values[evaluated]
        values = values[np.isfinite(values)]
        if column.own and len(values) and values.min() < values.max():
            own = Variable(column.name, column.unit, column.name, DERIVED)
            lower, upper = float(values.min()), float(values.max())
            shown.append(own._replace(lower=lower, upper=upper))
    return shown


def variable_paths(data: CampaignData) -> list[VariablePath]:
    """Return the path of each variable that is searched, and of each derived quantity."""
    rows, paths = data.generation_rows(), []
    evaluated = np.isin(data.string_rows()["string"], data.result_rows()["string"])
    strings = data.string_rows()[evaluated]
    for variable in shown_variables(data):
        tops = [values_of(data, row["population"][: row["top"]], variable.name) for row in rows]
        tops = [values[np.isfinite(values)] for values in tops]
        paths.append(
            VariablePath(
                variable,
                values_of(data, rows["best_string"], variable.name),
                np.array([v.min() if len(v) else np.nan for v in tops]),
                np.array([v.max() if len(v) else np.nan for v in tops]),
                values_of(data, strings["string"], variable.name),
                strings["generation"] + 1.0,
                strings["string"],
                unit_of_variable(data.campaign_text, variable),
            )
        )
    return paths


def draw_paths(figure: "matplotlib.figure.Figure", paths: Sequence[VariablePath]) -> Any:
    """Draw one panel for each of n variables, and return their axes, shape (n,)."""
    axes = panels(figure, len(paths), _panel_columns(len(paths)), "generation")
    for ax, path in zip(axes, paths, strict=True):
        _draw_path(ax, path)
    figure_legend(figure, axes[:1], 3)
    return axes


def _panel_columns(count: int) -> int:
    """Return the panels in a row: up to three, or five where there are ten variables."""
    return min(count, 3 if count <= 9 else 5)


def _draw_path(ax: Any, path: VariablePath) -> None:
    variable, (factor, unit) = path.variable, path.shown_unit
    generation = np.arange(1, len(path.best) + 1)
    ax.scatter(
        path.generation,
        path.evaluated / factor,
        s=6.0,
        color="0.55",
        linewidths=0,
        label="all strings judged",
        urls=[f"{STRING_LINK}{string}" for string in path.strings],
        zorder=3,
    )
    if np.any(path.most > path.least):
        ends = path.least / factor, path.most / factor
        style = {"color": "0.86", "linewidth": 0, "label": "range of the best strings"}
        ax.fill_between(generation, *ends, **style)
    marker = "o" if len(generation) < MAX_MARKED else ""
    style = {"color": COLOURS[0], "marker": marker, "markersize": 2.5, "label": "best string"}
    ax.plot(generation, path.best / factor, **style)
    ax.set_yscale("log" if variable.logarithmic else "linear")
    if variable.is_searched:  # an altered file may say otherwise
        lower, upper = variable.lower / factor, variable.upper / factor
        ax.set_ylim(lower, upper)
        ticks = few_ticks(lower, upper, variable.logarithmic)
        ax.set_yticks(ticks, [tick_text(tick) for tick in ticks])
        ax.yaxis.minorticks_off()
    ax.set_ylabel(variable_label(variable, unit))
    integer_ticks(ax.xaxis)


class BestStrings(NamedTuple):
    """The best n strings of a campaign, in order of rank, and d variables and derived quantities.

    Attributes
    ----------
    searched
    values
        SI units, shape (n, d).
    labels
        Texts of the legend for the first strings; the others are grey.
    estimated
        Whether each of these was estimated again; otherwise it is dashed.
    strings
        Their numbers, n.
    shown_units
        Factor and label of the unit of each variable, d.
    """

    searched: list[Variable]
    values: Floats
    labels: list[str]
    estimated: list[bool]
    strings: list[int]
    shown_units: list[tuple[float, str]]


def draw_best_strings(ax: Any, best: BestStrings) -> Any:
    """Draw strings as lines over their variables, each scaled to its range; return the axes."""
    values = best.values
    columns = zip(values.T, best.searched, strict=True)
    heights = np.column_stack([_relative_value(*each) for each in columns])
    across = np.arange(len(best.searched))
    for at in across:
        ax.axvline(at, color="0.8", linewidth=0.8, zorder=0)
    for place in reversed(range(len(values))):
        coloured = place < len(best.labels)
        ax.plot(
            across,
            heights[place],
            color=COLOURS[place % len(COLOURS)] if coloured else "0.8",
            linewidth=1.6 if coloured else 0.7,
            linestyle="--" if coloured and not best.estimated[place] else "-",
            marker="o" if coloured else "",
            markersize=4,
            label=best.labels[place] if coloured else None,
            zorder=2.0 + (len(values) - place) / len(values) if coloured else 1.0,
            url=f"{STRING_LINK}{best.strings[place]}",
        )
    _label_variables(ax, best)
    handles, labels = ax.get_legend_handles_labels()
    ax.legend(
        handles[::-1],
        labels[::-1],
        loc="lower center",
        bbox_to_anchor=(0.5, 1.1),
        ncols=2,
    )
    return ax


def _relative_value(values: Floats, variable: Variable) -> Floats:
    """Return values scaled to their range, 0 at its lower end and 1 at its upper."""
    lower, upper = variable.lower, variable.upper
    if variable.logarithmic:
        return np.log(values / lower) / np.log(upper / lower)
    return (values - lower) / (upper - lower)


def _label_variables(ax: Any, best: BestStrings) -> None:
    """Write the ends of the range above and below each line, and the names at the bottom."""
    ticks = []
    for at, (variable, shown) in enumerate(zip(best.searched, best.shown_units, strict=True)):
        factor, unit = shown
        style = {"ha": "center"}
        ax.text(at, 1.03, f"{variable.upper / factor:.6g}", va="bottom", **style)
        ax.text(at, -0.03, f"{variable.lower / factor:.6g}", va="top", **style)
        notes = [part for part in (unit, "log" if variable.logarithmic else "1") if part != "1"]
        note = f"\n({', '.join(notes)})" if notes else ""
        ticks.append(f"{variable_label(variable, '1')}{note}")
    slant = {"rotation": 40, "ha": "right", "rotation_mode": "anchor"}
    ax.set_xticks(range(len(ticks)), ticks, **(slant if len(ticks) > MAX_HORIZONTAL else {}))
    ax.tick_params(axis="x", length=0, pad=18)
    ax.set_yticks([])
    ax.set_ylim(0.0, 1.0)
    ax.set_xlim(-0.4, len(ticks) - 0.6)
    ax.spines[["top", "right", "left", "bottom"]].set_visible(False)


NamedSensitivity = tuple[Sequence[str], "Sensitivity"]
"""Names of variables, and their Sobol indices."""


def draw_sensitivity(ax: Any, found: NamedSensitivity) -> Any:
    """Draw first-order and total indices of d variables as bars, and return the axes."""
    names, indices = found
    order = np.argsort(-indices.total, kind="stable")
    place = np.arange(len(order))
    for shift, values, name, colour in (
        (-0.2, indices.first_order, "alone", COLOURS[0]),
        (0.2, indices.total, "with others", COLOURS[4]),
    ):
        ax.barh(place + shift, 100.0 * values[order], 0.38, color=colour, label=name)
    ax.set_yticks(place, [label_of(names[i].replace(".", ": ")) for i in order])
    ax.invert_yaxis()
    ax.set_xlabel("share of the variance of the objective (%)")
    legend_below(ax)
    return ax


def _paths_data(data: CampaignData, _: FigureOptions) -> list[VariablePath] | None:
    paths = variable_paths(data)
    return paths if paths and len(data.generation_rows()) else None


def _paths_size(paths: Sequence[VariablePath]) -> tuple[float, float]:
    columns = _panel_columns(len(paths))
    return min(PANEL_SIZE[0] * columns, PAGE), PANEL_SIZE[1] * -(-len(paths) // columns) + 0.7


def _best_data(data: CampaignData, _: FigureOptions) -> BestStrings | None:
    shown = rank_strings(data).order[: BEST + OTHERS]
    if not shown or not searched_variables(data):
        return None
    variables = shown_variables(data)
    columns = [values_of(data, shown, variable.name) for variable in variables]
    again = {estimate.string: estimate.objective for estimate in rank_strings(data).estimates}
    labels = []
    for place, string in enumerate(shown[:BEST], 1):
        searched = float(rank_strings(data).results[string]["objective"])
        label = f"#{place} string {string}: as searched {searched:.4g}"
        if string in again:
            label += f", re-estimate {again[string]:.4g}"
        labels.append(label)
    estimated = [string in again for string in shown[:BEST]]
    units = [unit_of_variable(data.campaign_text, each) for each in variables]
    return BestStrings(variables, np.column_stack(columns), labels, estimated, shown, units)


def _best_caption(best: BestStrings) -> str:
    grey = len(best.values) - len(best.labels)
    more = f", the next {grey} in grey" if grey else ""
    derived = any(variable.meaning == DERIVED for variable in best.searched)
    also = ", or a derived quantity over the range that it took" if derived else ""
    dashed = "" if all(best.estimated) else " Dashed: strings that were not estimated again."
    return (
        f"The best strings with their objectives, as searched and on fresh samples{more}.{dashed} "
        f"Every line is a variable from the bottom to the top of the search box{also}."
    )


def _sensitivity_data(data: CampaignData, options: FigureOptions) -> NamedSensitivity | None:
    if not options.sensitivity:
        return None
    from agglom_mpi.analysis.sensitivity import sensitivity_of

    names, indices = sensitivity_of(data)
    return None if indices is None or not indices.predicts else (names, indices)


def _sensitivity_caption(found: NamedSensitivity) -> str:
    _, indices = found
    return (
        "Share of the variance of the objective over the search box that each variable explains "
        f"(Sobol indices), by a regression of {indices.strings} strings; it predicts "
        f"{indices.explained:.0%} of the variance of strings left out, noise of samples is "
        f"{indices.noise:.0%}."
    )


Figure(
    "search_paths",
    "search",
    1,
    _paths_data,
    draw_paths,
    "Variables of the best string after each generation, over the range of the best strings "
    "(their spread at the end is that of the answer) and all strings that were judged. The "
    "panels are as high as the search box.",
    _paths_size,
    empty="no generation is done yet",
    panels=True,
    method="plot_search_paths",
    meaning="Draw each variable of the best strings against generation, one panel each.",
    takes=("figure",),
)

Figure(
    "best_strings",
    "search",
    2,
    _best_data,
    draw_best_strings,
    _best_caption,
    (PAGE, 4.6),
    empty="no string is judged yet",
    method="plot_best",
    meaning="Draw the best strings as lines over the search box.",
)

Figure(
    "sensitivity",
    "search",
    4,
    _sensitivity_data,
    draw_sensitivity,
    _sensitivity_caption,
    lambda found: (MIDDLE, 1.5 + 0.28 * len(found[0])),
    empty="too few strings, all worth the same, or a regression that predicts nothing",
)
