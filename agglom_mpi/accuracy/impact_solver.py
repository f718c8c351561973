"""The published iteration of an impact against the root finder: error, failures and time."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.accuracy.document import (
    MARKERS,
    Curve,
    ReportSection,
    ReportTable,
    Sentences,
    TableColumn,
    draw_curves,
)
from agglom_mpi.accuracy.impact_methods import (
    CAPS,
    DEMANDED,
    LEAST_TIMED,
    OUTCOMES,
    ROOT,
    SOFTENINGS,
    TIME,
    TOLERANCES,
    measure,
    name_of,
    outcomes,
    summary,
)
from agglom_mpi.accuracy.run_times import quartile_names, shown_time
from agglom_mpi.formatting import format_seconds
from agglom_mpi.report.drawing import COLOURS, Drawing

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

PUBLISHED: Final = name_of(CAPS[-1], TOLERANCES[1])
"""The published iteration whose outcomes are mapped."""

FLOOR: Final = 1e-17
"""Where a logarithmic axis shows errors of zero."""
OUTCOME_COLOURS: Final = ("0.85", "#009E73", "#E69F00", "#D55E00", "#56B4E9")


def impact_solver_section(quick: bool = False) -> ReportSection:
    """Return the section on how an impact is solved; `quick` measures fewer materials."""
    impacts = measure(quick)
    frame = summary(impacts)
    sentences = Sentences("impact_solver", **_findings(impacts, frame))
    return ReportSection(
        title="Impact solver",
        problem=sentences.paragraph("problem"),
        reference=sentences.paragraph("reference"),
        setups=sentences.paragraph("setups"),
        figures=(
            Drawing(
                "impact_solver",
                sentences.paragraph("work_caption"),
                lambda figure: _draw_work(figure, frame),
            ),
            Drawing(
                "impact_solver_map",
                sentences.paragraph("map_caption"),
                lambda figure: _draw_map(figure, impacts),
            ),
        ),
        tables=(
            ReportTable(
                "impact_solver", "One row is one method, over all impacts.", frame, COLUMNS
            ),
            ReportTable("impact_solver_impacts", "One row is one impact by one method.", impacts),
        ),
        failures=sentences.items("failures"),
        conclusions=sentences.items("conclusions"),
    )


def _findings(impacts: "pd.DataFrame", frame: "pd.DataFrame") -> dict[str, Any]:
    """Return what the sentences of the section refer to."""
    own = impacts[impacts["method"] == ROOT]
    bounces = own[~own["bonds"]]
    iterated = impacts[(impacts["method"] == PUBLISHED) & ~impacts["bonds"]]
    several = iterated[iterated["roots"] > 1]
    became = outcomes(several)
    flaws = ["capped", "another root", "wrongly bonded or not"]
    return {
        "own": own,
        "initial": sorted(own["a0"].unique()),
        "softenings": [
            {"name": name, "strength": SOFTENINGS[name][0], "rise": SOFTENINGS[name][1]}
            for name in own["softening"].unique()
        ],
        "least_timed": LEAST_TIMED,
        "time": TIME,
        "demanded": DEMANDED,
        "tolerance": TOLERANCES[1],
        "caps": CAPS,
        "closed": bounces[bounces["closed form"]],
        "searched": bounces[~bounces["closed form"]],
        "root": frame[frame["method"] == ROOT].iloc[0],
        "published": [
            {**frame[frame["method"] == name_of(cap, TOLERANCES[1])].iloc[0], "cap": cap}
            for cap in CAPS
        ],
        "converging": list(_converging(iterated)),
        "several": {
            "impacts": len(several),
            "smallest": (became == 1).sum(),
            "another": (became == 2).sum(),
            "capped": several["capped"].sum(),
        },
        "failing": [row for _, row in frame.iterrows() if row[flaws].any()],
    }


def _converging(bounces: "pd.DataFrame") -> Iterator[dict[str, Any]]:
    """Yield for each material without softening in how many impacts the iteration converges.

    `largest` is the largest X of these, or None.
    """
    plain = bounces[bounces["softening"] == "none"]
    for (paper, area), rows in plain.groupby(["paper", "a0"]):
        solved = rows[outcomes(rows) == 1]
        yield {
            "paper": paper,
            "initial": area,
            "solved": len(solved),
            "impacts": len(rows),
            "largest": solved["X"].max() if len(solved) else None,
        }


def _share(column: str) -> TableColumn:
    return TableColumn(column, lambda row: f"{row[column]} of {row['bounces']}")


COLUMNS: Final = (
    TableColumn("method", lambda row: row["method"]),
    _share("solved"),
    _share("capped"),
    _share("another root"),
    TableColumn("wrongly bonded or not", lambda row: f"{row['wrongly bonded or not']}"),
    TableColumn("median error of e", lambda row: f"{row['median error of e']:.1e}"),
    TableColumn("worst", lambda row: f"{row['worst error of e']:.1e}"),
    TableColumn(
        "median iterations",
        lambda row: "–" if math.isnan(row["cap"]) else f"{row['median iterations']:.0f}",
    ),
    shown_time("impact"),
    TableColumn("slowest material", lambda row: format_seconds(row["longest of a material (s)"])),
)


def _draw_work(figure: "matplotlib.figure.Figure", frame: "pd.DataFrame") -> None:
    groups = [(ROOT, frame[frame["method"] == ROOT])]
    groups += [(f"published, cap {cap:g}", own) for cap, own in frame.groupby("cap")]
    curves = []
    for name, own in groups:
        cost, low, high = (1e9 * own[column] for column in (TIME, *quartile_names("impact")))
        error = own["median error of e"].clip(lower=FLOOR)
        curves.append(Curve(name, cost, error, cost_low=low, cost_high=high))
    axes = draw_curves(figure, curves, "processor time of an impact (ns)", "error of e")
    for index, (_, own) in enumerate(groups):
        axes.plot(
            1e9 * own[TIME],
            own["worst error of e"].clip(lower=FLOOR),
            color=COLOURS[index],
            marker=MARKERS[index],
            markersize=4,
            fillstyle="none",
            linestyle="none",
        )
    decades = np.log10(1e9 * frame[TIME])
    axes.set_xlim(10.0 ** np.floor(decades.min()), 10.0 ** np.ceil(decades.max()))
    axes.legend(frameon=False, fontsize="small", loc="lower right")


def _draw_map(figure: "matplotlib.figure.Figure", impacts: "pd.DataFrame") -> None:
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    own = impacts[impacts["method"] == PUBLISHED]
    rows = list(own.groupby(["paper", "a0", "softening"], sort=False))
    x = np.unique(own["X"])
    edges = np.sqrt(x[1:] * x[:-1])
    edges = np.concatenate([[edges[0] ** 2 / edges[1]], edges, [edges[-1] ** 2 / edges[-2]]])
    axes = figure.subplots()
    colours = ListedColormap(OUTCOME_COLOURS)
    became = np.array([outcomes(group) for _, group in rows])
    axes.pcolormesh(edges, np.arange(len(rows) + 1), became, cmap=colours, vmin=-0.5, vmax=4.5)
    axes.set_xscale("log")
    axes.invert_yaxis()
    labels = [f"{paper} a₀ = {a:g}, {softening}" for (paper, a, softening), _ in rows]
    axes.set_yticks(np.arange(len(rows)) + 0.5, labels, fontsize=6)
    axes.set_xlabel("X, pressure at e = 0 over that of bonding")
    present = sorted(set(became.ravel().tolist()))
    axes.legend(
        handles=[Patch(color=OUTCOME_COLOURS[k], label=OUTCOMES[k]) for k in present],
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=len(present),
        frameon=False,
        fontsize="small",
    )
