"""The report of an answer study: figures of each factor, tables, one sentence on each setting."""

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.accuracy.answer.errors import COST_SAMPLES, COST_SECONDS, Answers
from agglom_mpi.accuracy.answer.times_to_targets import Band, TimesToTargets
from agglom_mpi.accuracy.report import (
    MARKERS,
    ReportSection,
    RowColumn,
    Sentences,
    busy_lines,
    frame_table,
    write_document,
)
from agglom_mpi.accuracy.study import StudyOptions
from agglom_mpi.analysis.tables import wall_over_cpu
from agglom_mpi.config.answer_study import AnswerStudy, file_stem
from agglom_mpi.display.table import Column
from agglom_mpi.formatting import format_duration, format_seconds
from agglom_mpi.report.style import COLOURS, PAGE, Drawing
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

FACTOR_SIZE: Final = (PAGE, 6.0)
"""Width and height of the figure of a factor, inches."""
COSTS: Final = (COST_SAMPLES, COST_SECONDS)
"""The costs, as columns name them."""
BOOTSTRAP_SEED: Final = 46
"""Seed of the resampling of runs, so that a report is the same each time."""


Times = dict[str, TimesToTargets]
"""Times to each target of the runs of a setting, by the cost."""


def write_answer_report(
    directory: Path,
    study: AnswerStudy,
    answers: Answers,
    options: StudyOptions,
    file: CampaignData,
) -> Path:
    """Write the report with its figures and CSV files; return its path.

    Parameters
    ----------
    directory, study, answers, options
    file
        With the fresh samples.
    """
    times, rows = times_of(study, answers), file.all_sample_rows()
    spent, used = (
        sum(float(each[cost].spent.sum()) for each in times)
        for cost in (COST_SECONDS, COST_SAMPLES)
    )
    facts = [
        shlex.join(options.words()),
        f"{len(times) * study.seeds} runs, {study.seeds} of each setting: {used:,.0f} samples, "
        f"{format_duration(spent)} of processor time; {len(rows):,} fresh samples",
        *busy_lines(wall_over_cpu(rows)),
    ]
    title = f"The error of the answer against its cost: {study.title}"
    section = answer_section(study, answers, times)
    return write_document(directory, title, facts, {"The answers of whole searches": [section]})


def answer_section(study: AnswerStudy, answers: Answers, times: Sequence[Times]) -> ReportSection:
    """Return the section on all settings."""
    expected = expected_times(study, times)
    compared = expected[expected["target"] == study.compared]
    small = [f"{target:g}" for target in study.targets if target < answers.resolution]
    sentences = Sentences(
        "answer",
        study=study,
        answers=answers,
        small=", ".join(small),
        lines=[
            (row["setting"], _reaching(row), band_text(_expected(row, COST_SAMPLES)))
            for _, row in compared.iterrows()
        ],
    )
    what = f"Expected cost of an error of at most {study.compared:g}: one row is one setting."
    tables = [
        frame_table(compared, what, "compared", EXPECTED_COLUMNS),
        frame_table(expected, "One row is one setting and target.", "expected_run_times"),
        frame_table(answers.frame, "One row is one generation of a run.", "answers"),
    ]
    of_stem = {each.stem: found for each, found in zip(study.settings, times, strict=True)}
    targets, figures = ", ".join(f"{target:g}" for target in study.targets), []
    for factor, settings in study.factors.items():
        caption = (
            f"{factor.capitalize()}: share of all pairs of a run and a target ({targets}) that are "
            f"reached, and the expected cost of a target with its 95 % band. × is the mean cost of "
            f"a whole run, an arrow the open end of a band, and a hollow one the bound of a target "
            f"that no run reaches."
        )
        own = {setting.name: of_stem[setting.stem] for setting in settings}
        draw = partial(draw_factor, times=own, targets=study.targets, quantity=answers.quantity)
        figures.append(Drawing(f"answer_{file_stem(factor)}", caption, draw, FACTOR_SIZE))
    return sentences.section("Settings of a search", figures, tables)


def times_of(study: AnswerStudy, answers: Answers) -> list[Times]:
    """Return the times of all settings, the default first."""
    found = []
    for frame in answers.by_setting(study):
        runs = [rows for _, rows in frame.groupby("seed", sort=True)]
        errors = [rows["bound"].to_numpy(np.float64) for rows in runs]
        costs = {cost: [rows[cost].to_numpy(np.float64) for rows in runs] for cost in COSTS}
        found.append(
            {cost: TimesToTargets.of_runs(costs[cost], errors, study.targets) for cost in COSTS}
        )
    return found


def expected_times(study: AnswerStudy, times: Sequence[Times]) -> "pd.DataFrame":
    """Return the expected run times of each setting and target, with bands."""
    import pandas as pd

    rows = []
    for setting, each in zip(study.settings, times, strict=True):
        random = np.random.default_rng(BOOTSTRAP_SEED)
        bands = {cost: each[cost].band(random) for cost in COSTS}
        runs = each[COST_SAMPLES]
        for place, target in enumerate(study.targets):
            row: dict[str, object] = {
                "factor": setting.factor,
                "setting": setting.name,
                "target": target,
                "runs": runs.runs,
                "runs that reach it": int(runs.successes[place]),
            }
            for cost, band in bands.items():
                row |= dict(zip(band_names(f"expected {cost}"), band[place], strict=True))
            rows.append(row)
    return pd.DataFrame(rows)


def band_names(name: str) -> tuple[str, str, str]:
    """Return the columns of a value and its band."""
    return name, f"{name}, low", f"{name}, high"


def band_text(band: Band, form: Callable[[float], str] = "{:.0f}".format) -> str:
    """Return a band as text: `310 (250 to 420)`."""
    if math.isnan(band.value):
        return "unknown"
    value, low, high = ("∞" if math.isinf(end) else form(end) for end in band)
    return f"more than {low}" if math.isinf(band.value) else f"{value} ({low} to {high})"


def _expected(row: Any, cost: str) -> Band:
    return Band(*(row[name] for name in band_names(f"expected {cost}")))


def _reaching(row: Any) -> str:
    return f"{row['runs that reach it']} of {row['runs']} runs"


EXPECTED_COLUMNS: Final = (
    Column("factor", text=True),
    Column("setting", text=True),
    RowColumn("reached", format=_reaching),
    RowColumn("samples", format=lambda row: band_text(_expected(row, COST_SAMPLES))),
    RowColumn(
        "processor time", format=lambda row: band_text(_expected(row, COST_SECONDS), format_seconds)
    ),
)


def draw_factor(
    figure: "matplotlib.figure.Figure",
    times: Mapping[str, Times],
    targets: Sequence[float],
    quantity: str,
) -> Any:
    """Draw shares (above) and expected costs (below) against samples and processor time.

    Returns the axes, (4,). The `times` are by the names of the settings.
    """
    axes = figure.subplots(2, 2, sharex="col", sharey="row")
    for column, cost in enumerate(COSTS):
        for index, (name, each) in enumerate(times.items()):
            style = {"color": COLOURS[index % len(COLOURS)], "label": name}
            _draw_share(axes[0, column], each[cost], style)
            shift = 1.0 + 0.05 * (index - 0.5 * (len(times) - 1))  # bands side by side
            places = [target * shift for target in targets]
            _draw_expected(
                axes[1, column], each[cost], places, style["color"], MARKERS[index % len(MARKERS)]
            )
        for axis in axes[:, column]:
            axis.set_xscale("log")
        axes[1, column].set_xlabel(cost)
    axes[0, 0].set_ylabel("fraction of runs × targets reached")
    axes[0, 0].set_ylim(-0.02, 1.02)
    axes[1, 0].set_yscale("log")
    axes[1, 0].set_yticks(targets, [f"{target:g}" for target in targets])
    axes[1, 0].set_ylim(0.8 * targets[-1], 1.25 * targets[0])
    axes[1, 0].minorticks_off()
    axes[1, 0].set_ylabel(f"target: {quantity}")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return axes.ravel()


def _draw_share(axis: Any, times: TimesToTargets, style: dict[str, Any]) -> None:
    """Draw the share of targets reached as a staircase that ends at the mean cost of a run."""
    costs = np.unique(times.reached[np.isfinite(times.reached)])
    end = float(times.spent.mean())
    steps = np.append(costs, max(end, costs[-1] if len(costs) else end))
    shares = times.share(steps)
    start = steps[:1] * 0.5
    axis.step(np.append(start, steps), np.append(0.0, shares), where="post", lw=1.4, **style)
    axis.plot(end, times.share([end])[0], "x", color=style["color"], markersize=7)


def _draw_expected(
    axis: Any, times: TimesToTargets, places: Sequence[float], colour: str, marker: str
) -> None:
    """Draw the expected cost of each target with its band, at its place from below."""
    drawn = list(zip(times.band(np.random.default_rng(BOOTSTRAP_SEED)), places, strict=True))
    reached = [(band.value, at) for band, at in drawn if np.isfinite(band.value)]
    highest = max([float(times.spent.sum()), *(value for value, _ in reached)])
    for band, at in drawn:
        if np.isinf(band.value):
            axis.plot(band.low, at, ">", color=colour, markerfacecolor="none", markersize=5)
            continue
        # An open band ends at the cost of all runs together.
        ends = band.low, highest if np.isinf(band.high) else band.high
        axis.plot(ends, [at, at], color=colour, lw=1.0)
        if np.isinf(band.high):
            axis.plot(ends[1], at, ">", color=colour, markersize=5)
    values, heights = [value for value, _ in reached], [at for _, at in reached]
    axis.plot(values, heights, color=colour, marker=marker, markersize=4, lw=0.8)
