"""The published iteration of an impact against the root finder: error, failures and time."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.accuracy.curves import COLOURS, MARKERS, Curve, draw_curves
from agglom_mpi.accuracy.impact_outcomes import (
    CAPS,
    DEMANDED,
    LEAST_TIMED,
    OUTCOMES,
    ROOT,
    SOFTENINGS,
    TOLERANCES,
    measure,
    name_of,
    outcomes,
    summary,
)
from agglom_mpi.accuracy.section import Section, Shown, Table
from agglom_mpi.formatting import format_digits, format_percent, format_seconds
from agglom_mpi.report.drawing import Drawing

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

FLOOR: Final = 1e-17
"""Where a logarithmic axis shows errors of zero."""
OUTCOME_COLOURS: Final = ("0.85", "#009E73", "#E69F00", "#D55E00", "#56B4E9")


def impact_solver(quick: bool = False) -> Section:
    """Section on how an impact is solved."""
    impacts = measure(quick)
    frame = summary(impacts)
    return Section(
        title="Impact solver",
        problem=(
            "One impact is one equation e = G(e). Both papers iterate it; the package brackets the "
            "root, or walks to it where there may be several. How far from the solution does each "
            "end, how often not at all, and what does it cost?"
        ),
        reference=(
            "The closed form where nothing softens; elsewhere the smallest root of a dense scan "
            "in ln(1 − e), bisected in extended precision, written without the package's formulas."
        ),
        setups=_setups(impacts),
        figures=(
            Drawing(
                "impact_solver",
                "Error of e against the time of an impact: medians with lines, worst without. "
                "The three points of a line are the tolerances.",
                lambda figure: _draw_work(figure, frame),
            ),
            Drawing(
                "impact_solver_map",
                f"What becomes of an impact under the iteration as published, cap {CAPS[-1]}, to "
                f"{TOLERANCES[1]:g}. Rows are materials: the paper whose duration of contact it "
                "has, a₀, and softening.",
                lambda figure: _draw_map(figure, impacts),
            ),
        ),
        tables=(
            Table("impact_solver", "One row is one method, over all impacts.", frame, SHOWN),
            Table("impact_solver_impacts", "One row is one impact by one method.", impacts),
        ),
        failures=tuple(_failures(frame)),
        conclusions=tuple(_conclusions(impacts, frame)),
    )


def _setups(impacts: "pd.DataFrame") -> str:
    own = impacts[impacts["method"] == ROOT]
    initial = ", ".join(f"{a:g}" for a in sorted(own["a0"].unique()))
    strengths = "; ".join(
        f"{name}: U/(Rθ) = {SOFTENINGS[name][0]:g}, θ rises by "
        f"{format_percent(SOFTENINGS[name][1])}"
        for name in own["softening"].unique()
    )
    return (
        f"{len(own)} impacts: X from {own['X'].min():.2g} to {own['X'].max():.2g}, pairs bond from "
        f"X = 1; a₀ = {initial}; both durations of contact [A 12] [B 4.10]; softening by the heat "
        f"of a perfectly plastic impact ({strengths}). The published iteration e ← G(e) starts at "
        "e = 0 and tests bonding there only, with every cap and tolerance. Times are medians of "
        f"loops over {LEAST_TIMED} impacts and more in one compiled kernel."
    )


def _share(column: str) -> Shown:
    return Shown(column, lambda row: f"{row[column]} of {row['bounces']}")


SHOWN: Final = (
    Shown("method", lambda row: row["method"]),
    _share("solved"),
    _share("capped"),
    _share("another root"),
    Shown("wrongly bonded or not", lambda row: f"{row['wrongly bonded or not']}"),
    Shown("median error of e", lambda row: f"{row['median error of e']:.1e}"),
    Shown("worst", lambda row: f"{row['worst error of e']:.1e}"),
    Shown(
        "median iterations",
        lambda row: "–" if math.isnan(row["cap"]) else f"{row['median iterations']:.0f}",
    ),
    Shown("time", lambda row: format_seconds(row["seconds per impact (s)"])),
    Shown("at most", lambda row: format_seconds(row["longest of a material (s)"])),
)


def _draw_work(figure: "matplotlib.figure.Figure", frame: "pd.DataFrame") -> None:
    groups = [(ROOT, frame[frame["method"] == ROOT])]
    groups += [(f"published, cap {cap:g}", own) for cap, own in frame.groupby("cap")]
    curves = []
    for name, own in groups:
        cost = 1e9 * own["seconds per impact (s)"]
        curves.append(Curve(name, cost, own["median error of e"].clip(lower=FLOOR)))
    axes = draw_curves(figure, curves, "time of an impact (ns)", "error of e")
    for index, (_, own) in enumerate(groups):
        axes.plot(
            1e9 * own["seconds per impact (s)"],
            own["worst error of e"].clip(lower=FLOOR),
            color=COLOURS[index],
            marker=MARKERS[index],
            markersize=4,
            fillstyle="none",
            linestyle="none",
        )
    decades = np.log10(1e9 * frame["seconds per impact (s)"])
    axes.set_xlim(10.0 ** np.floor(decades.min()), 10.0 ** np.ceil(decades.max()))
    axes.legend(frameon=False, fontsize="small", loc="lower right")


def _draw_map(figure: "matplotlib.figure.Figure", impacts: "pd.DataFrame") -> None:
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    own = impacts[impacts["method"] == name_of(CAPS[-1], TOLERANCES[1])]
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


def _failures(frame: "pd.DataFrame") -> Iterator[str]:
    for _, row in frame.iterrows():
        failed = [
            f"{row[column]} {words}"
            for column, words in (
                ("capped", "end at the cap"),
                ("another root", "end at another root than the smallest"),
                ("wrongly bonded or not", "are wrongly bonded or not"),
            )
            if row[column]
        ]
        if failed:
            yield f"{row['method']}: of {row['bounces']} bounces, {', '.join(failed)}."


def _conclusions(impacts: "pd.DataFrame", frame: "pd.DataFrame") -> Iterator[str]:
    root = frame[frame["method"] == ROOT].iloc[0]
    yield from _on_the_root_finder(impacts[impacts["method"] == ROOT], root)
    for cap in CAPS:
        row = frame[frame["method"] == name_of(cap, TOLERANCES[1])].iloc[0]
        ratio = row["seconds per impact (s)"] / root["seconds per impact (s)"]
        yield (
            f"The published iteration with a cap of {cap} and a tolerance of {TOLERANCES[1]:g} is "
            f"within {DEMANDED:g} in {row['solved']} of {row['bounces']} impacts, and takes "
            f"{format_seconds(row['seconds per impact (s)'])}, {format_digits(ratio)} times the "
            f"root finder's time."
        )
    yield from _on_convergence(impacts[impacts["method"] == name_of(CAPS[-1], TOLERANCES[1])])


def _on_the_root_finder(own: "pd.DataFrame", root: Any) -> Iterator[str]:
    bounces = own[~own["bonds"]]
    known, others = bounces[bounces["closed form"]], bounces[~bounces["closed form"]]
    yield (
        f"The root finder is within {known['error of e'].max():.0e} of the closed form in all "
        f"{len(known)} impacts that have one, and within {others['error of e'].max():.0e} of the "
        f"brute force in the {len(others)} others; {root['capped']} end at a cap. An impact takes "
        f"{format_seconds(root['seconds per impact (s)'])}, with the slowest material "
        f"{format_seconds(root['longest of a material (s)'])}."
    )


def _on_convergence(own: "pd.DataFrame") -> Iterator[str]:
    """Where the published iteration converges at all."""
    bounces = own[~own["bonds"]]
    plain = bounces[bounces["softening"] == "none"]
    for (paper, a), rows in plain.groupby(["paper", "a0"]):
        solved = rows[outcomes(rows) == 1]
        reach = f"up to X = {solved['X'].max():.2g}" if len(solved) else "for no X"
        yield (
            f"Without softening and with the duration of {paper} and a₀ = {a:g} it converges in "
            f"{len(solved)} of {len(rows)} impacts, {reach}."
        )
    several = bounces[bounces["roots"] > 1]
    became = outcomes(several)
    yield (
        f"Of {len(several)} impacts with several roots it ends within {DEMANDED:g} of the smallest "
        f"in {(became == 1).sum()}, at another in {(became == 2).sum()}, at its cap in "
        f"{several['capped'].sum()}."
    )
