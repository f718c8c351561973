"""The Pareto front of several campaign files as a figure, a table and CSV."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rich.console import Group, RenderableType

from agglom_mpi.analysis.tables import with_units
from agglom_mpi.analysis.trade_off import (
    DOMINATED,
    FRONT,
    RESOLVED,
    UNRESOLVED,
    TradeOff,
    TradeOffAxis,
    TradeOffError,
)
from agglom_mpi.display.fitted_table import FittedTable
from agglom_mpi.errors import require_library
from agglom_mpi.formatting import in_unit, value_with_error
from agglom_mpi.report.drawing import (
    COLOURS,
    Drawing,
    axis_label,
    legend_below,
    log_ticks,
    scaled_unit,
    style_axes,
    write_drawing,
)
from agglom_mpi.storage.files import atomic_file, require_absent, require_writable_folder

if TYPE_CHECKING:
    import pandas as pd

COLOUR_OF: Final = {FRONT: COLOURS[0], UNRESOLVED: COLOURS[4], DOMINATED: "0.55"}
NOTE: Final = "bars: ± 2 standard errors; open circles: as searched"
MANY_TIMES: Final = 50.0
"""Ratio of the largest to the smallest number without error from which its axis is logarithmic."""
CAPTION: Final = "The best strings of several campaigns, with two standard errors."


def write_trade_off(stem: Path, found: TradeOff) -> list[str]:
    """Write STEM.png, STEM.svg and STEM.csv; return their names.

    Raises
    ------
    TradeOffError
        If the stem is no name.
    FileExistsError
        If there is one of them already.
    OSError
        If they cannot be written.
    MissingLibraryError
        If matplotlib or pandas is missing.
    """
    require_library("matplotlib", "report", "figures")
    require_library("pandas", "report", "tables")
    if not stem.name:
        raise TradeOffError(f"{stem}: is no name of files; give one like front")
    paths = [stem.with_name(f"{stem.name}.{kind}") for kind in ("csv", "png", "svg")]
    for path in paths:
        require_absent(path)
        require_writable_folder(path)
    with atomic_file(paths[0]) as temporary:
        table = with_units(trade_off_table(found))
        table.to_csv(temporary, index=False, na_rep="nan", lineterminator="\n")
    drawing = Drawing(
        stem.name, CAPTION, lambda figure: draw_trade_off(figure.subplots(), found), (6.0, 4.4)
    )
    write_drawing(stem.parent, drawing)
    return [str(path) for path in paths]


def trade_off_table(found: TradeOff) -> "pd.DataFrame":
    """Tabulate the best string of each file, in SI units with standard errors."""
    import pandas as pd

    columns: dict[str, Any] = {
        "file": [point.file for point in found.points],
        "title": [point.title for point in found.points],
        "string": [point.string for point in found.points],
    }
    units = dict.fromkeys(columns, "")
    for k, axis in enumerate(found.axes):
        error = f"{axis.name}_standard_error"
        columns[axis.name] = [point.values[k] for point in found.points]
        columns[error] = [point.errors[k] for point in found.points]
        units |= {axis.name: axis.unit, error: axis.unit}
    columns["fresh"] = [point.fresh for point in found.points]
    columns["verdict"] = found.verdicts
    table = pd.DataFrame(columns)
    table.attrs["units"] = units
    return table


def trade_off_text(found: TradeOff) -> RenderableType:
    """Return the table that is printed."""
    headings = [f"{in_unit(a.name, a.unit)}, {_sense(a)}" for a in found.axes]
    table = FittedTable("file", "string", *headings, "", left=(0, 4))
    for point, verdict in zip(found.points, found.verdicts, strict=True):
        pairs = zip(point.values, point.errors, strict=True)
        cells = [value_with_error(v, e) if e > 0.0 else f"{v:.4g}" for v, e in pairs]
        name = point.file if point.fresh else f"{point.file} (as searched)"
        table.add_row(name, str(point.string), *cells, verdict)
    lines = [
        f"± is a standard error; dominated: another is better by {RESOLVED:g} or more on both axes"
    ]
    if not all(point.fresh for point in found.points):
        lines.append(
            "as searched: no fresh samples; the samples that a string was chosen by favour it"
        )
    return Group(table, *lines)


def _sense(axis: TradeOffAxis) -> str:
    return "maximised" if axis.maximised else "minimised"


def draw_trade_off(ax: Any, found: TradeOff) -> Any:
    """Draw points with two standard errors, and the front as steps between them; return the axes.

    The steps are what the front's points dominate: between two of them, no better string is known
    than these.
    """
    style_axes(ax)
    scales = []
    for k, (axis, name) in enumerate(zip(found.axes, ("x", "y"), strict=True)):
        largest = max(abs(point.values[k]) for point in found.points)
        scale, unit = scaled_unit(axis.unit, largest)
        scales.append(scale)
        getattr(ax, f"set_{name}label")(f"{axis_label(axis.name, unit)}, {_sense(axis)}")
    rows = list(zip(found.points, found.verdicts, strict=True))
    front = sorted(
        (point.values[0] / scales[0], point.values[1] / scales[1])
        for point, verdict in rows
        if verdict == FRONT
    )
    where = "pre" if found.axes[0].maximised else "post"
    ax.step(*zip(*front, strict=True), where=where, color=COLOUR_OF[FRONT], linewidth=1, zorder=1)
    seen = set()
    for point, verdict in rows:
        x, y = (value / scale for value, scale in zip(point.values, scales, strict=True))
        bars = [RESOLVED * e / scale for e, scale in zip(point.errors, scales, strict=True)]
        colour, label = COLOUR_OF[verdict], None if verdict in seen else verdict
        seen.add(verdict)
        face = colour if point.fresh else "white"
        style = {"fmt": "o", "color": colour, "markerfacecolor": face, "capsize": 2}
        ax.errorbar(x, y, xerr=bars[0] or None, yerr=bars[1] or None, label=label, **style)
        text = {"textcoords": "offset points", "fontsize": "small", "color": colour}
        ax.annotate(Path(point.file).stem, (x, y), (5, 5), **text)
    ax.margins(x=0.18, y=0.1)
    ax.set_title(NOTE, fontsize="small", color="0.35")
    for k, axis in enumerate((ax.xaxis, ax.yaxis)):
        values = [point.values[k] / scales[k] for point in found.points]
        exact = not any(point.errors[k] for point in found.points)
        if exact and min(values) > 0.0 and max(values) > MANY_TIMES * min(values):
            axis.axes.set(**{f"{axis.axis_name}scale": "log"})
            log_ticks(axis)
    legend_below(ax, 3)
    return ax
