"""The report of an answer study: a figure of each factor, tables, one sentence on each setting."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.accuracy.answer_errors import SAMPLES, SECONDS, Answers
from agglom_mpi.accuracy.answer_tables import (
    BOOTSTRAP_SEED,
    COSTS,
    SettingTimes,
    band_text,
    expected_times,
    last_answers,
    sentence,
    times_of,
)
from agglom_mpi.accuracy.document import MARKERS, NAME
from agglom_mpi.accuracy.times_to_targets import TimesToTargets
from agglom_mpi.analysis.tables import csv_texts
from agglom_mpi.config.answer_study import AnswerStudy, file_stem
from agglom_mpi.formatting import format_digits, format_duration
from agglom_mpi.report.drawing import COLOURS, Drawing, log_ticks, style_axes, write_drawing
from agglom_mpi.runtime.provenance import processor
from agglom_mpi.storage.files import replace_file
from agglom_mpi.version import __version__

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

FIGURE_SIZE: Final = (9.0, 7.4)
"""Width and height of the figure of a factor, inches."""
LABELS: Final = {SAMPLES: "samples", SECONDS: "processor time (s)"}
"""Labels of the axes of costs."""


class AnswerReport(NamedTuple):
    """What a report is made of.

    Attributes
    ----------
    study
    answers
    command
        The command that made it.
    estimates
        Number of samples of the re-estimates.
    remarks
        Further lines on how it was made.
    """

    study: AnswerStudy
    answers: Answers
    command: str
    estimates: int
    remarks: tuple[str, ...] = ()


def write_answer_report(directory: Path, report: AnswerReport) -> Path:
    """Write the report with its figures and CSV files into a directory; return its path."""
    study, answers = report.study, report.answers
    times = times_of(study, answers)
    tables = {
        "answers": answers.frame,
        "expected_run_times": expected_times(study, times),
        "last_answers": last_answers(study, answers),
    }
    for name, frame in tables.items():
        replace_file(directory / f"{name}.csv", csv_texts(frame).to_csv(index=False).encode())
    drawings = list(factor_drawings(study, answers, times))
    for drawing in drawings:
        write_drawing(directory, drawing)
    lines = [*_head(report, times), *_summary(study, times), *_last(study, tables["last_answers"])]
    for drawing in drawings:
        title = drawing.caption.partition(":")[0]
        lines += [f"![{title}]({drawing.name}.png)", "", f"*{drawing.caption}*", ""]
    lines.append("Every number: " + ", ".join(f"`{name}.csv`" for name in tables) + ".")
    path = directory / NAME
    replace_file(path, ("\n".join(lines) + "\n").encode())
    return path


def _head(report: AnswerReport, times: Sequence[SettingTimes]) -> Iterator[str]:
    """Yield title, command and facts."""
    study, answers = report.study, report.answers
    runs = sum(each.samples.runs for each in times)
    spent = sum(float(each.seconds.spent.sum()) for each in times)
    used = sum(float(each.samples.spent.sum()) for each in times)
    yield from (f"# The error of the answer against its cost: {study.title}", "")
    yield from (f"`{report.command}`", "")
    yield f"- error: {answers.quantity}; {answers.reference}"
    yield (
        f"- {runs} runs, {study.seeds} of each setting: {used:,.0f} samples, "
        f"{format_duration(spent)} of processor time; {report.estimates:,} fresh samples"
    )
    small = [f"{target:g}" for target in study.targets if target < answers.resolution]
    if small:
        yield f"- targets below the resolution of {answers.resolution:.2g}: {', '.join(small)}"
    yield f"- bands: 95 %, by resampling the runs; agglom_mpi {__version__}, {processor()}"
    yield from (f"- {remark}" for remark in report.remarks)
    yield ""


def _summary(study: AnswerStudy, times: Sequence[SettingTimes]) -> Iterator[str]:
    """Yield the table of expected run times at the compared target, with a sentence on each."""
    place = study.targets.index(study.compared)
    yield from (f"Expected cost of an error of at most {study.compared:g}:", "")
    yield "| factor | setting | samples | processor time | in a sentence |"
    yield "|---|---|---|---|---|"
    for each in times:
        random = np.random.default_rng(BOOTSTRAP_SEED)
        [samples], [seconds] = (each.by(cost).at(place).band(random) for cost in COSTS)
        cells = (
            each.setting.factor,
            each.setting.name,
            band_text(samples),
            band_text(seconds, "time"),
            sentence(study, each, times[0]),
        )
        yield f"| {' | '.join(cells)} |"
    yield ""


def _last(study: AnswerStudy, frame: "pd.DataFrame") -> Iterator[str]:
    """Yield the table of the answers that users would publish, those at the end of the runs."""
    yield from ("The answers at the end of the runs:", "")
    yield f"| setting | error, mean | least to most | within {study.compared:g} | samples | time |"
    yield "|---|---|---|---|---|---|"
    for _, row in frame.iterrows():
        error = [format_digits(row[f"error, {name}"]) for name in ("mean", "least", "most")]
        cells = (
            row["setting"],
            error[0],
            f"{error[1]} to {error[2]}",
            f"{100 * row['last answer within the target']:.0f} %",
            f"{row[f'{SAMPLES}, mean']:.0f}",
            f"{row[f'{SECONDS}, mean']:.3g} s",
        )
        yield f"| {' | '.join(cells)} |"
    yield ""


def factor_drawings(
    study: AnswerStudy, answers: Answers, times: Sequence[SettingTimes]
) -> Iterator[Drawing]:
    """Yield a figure of each factor."""
    by_name = {(each.setting.factor, each.setting.name): each for each in times}
    targets = ", ".join(f"{target:g}" for target in study.targets)
    for factor, settings in study.factors.items():
        own = [by_name[setting.factor, setting.name] for setting in settings]
        yield Drawing(
            f"answer_{file_stem(factor)}",
            f"{factor.capitalize()}: share of all pairs of a run and a target ({targets}) that are "
            f"reached, and the expected cost of a target with its 95 % band. × is the mean cost of "
            f"a whole run, an arrow the open end of a band, and a hollow one the bound of a target "
            f"that no run reaches.",
            partial(draw_factor, times=own, study=study, quantity=answers.quantity),
            FIGURE_SIZE,
        )


def draw_factor(
    figure: "matplotlib.figure.Figure",
    times: Sequence[SettingTimes],
    study: AnswerStudy,
    quantity: str,
) -> None:
    """Draw shares (above) and expected costs (below) against samples and processor time."""
    axes = figure.subplots(2, 2, sharex="col", sharey="row")
    for column, cost in enumerate(COSTS):
        for index, each in enumerate(times):
            style = {"color": COLOURS[index % len(COLOURS)], "label": each.setting.name}
            _draw_share(axes[0, column], each.by(cost), style)
            shift = 1.0 + 0.05 * (index - 0.5 * (len(times) - 1))  # bands side by side
            _draw_expected(axes[1, column], each.by(cost), study.targets, style, index, shift)
        for axis in axes[:, column]:
            style_axes(axis)
            axis.set_xscale("log")
        log_ticks(axes[1, column].xaxis)
        axes[1, column].set_xlabel(LABELS[cost])
    axes[0, 0].set_ylabel("share of runs × targets reached")
    axes[0, 0].set_ylim(-0.02, 1.02)
    axes[1, 0].set_yscale("log")
    axes[1, 0].set_yticks(study.targets, [f"{target:g}" for target in study.targets])
    axes[1, 0].set_ylim(0.8 * study.targets[-1], 1.25 * study.targets[0])
    axes[1, 0].minorticks_off()
    axes[1, 0].set_ylabel(f"target: {quantity}")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=3, frameon=False, fontsize="small"
    )


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
    axis: Any,
    times: TimesToTargets,
    targets: Sequence[float],
    style: dict[str, Any],
    index: int,
    shift: float,
) -> None:
    """Draw the expected cost of each target with its band."""
    bands, colour = times.band(np.random.default_rng(BOOTSTRAP_SEED)), style["color"]
    places = [(band, target * shift) for band, target in zip(bands, targets, strict=True)]
    reached = [(band, at) for band, at in places if np.isfinite(band.value)]
    highest = max([float(times.spent.sum()), *(band.value for band, _ in reached)])
    for band, at in places:
        if np.isinf(band.value):
            axis.plot(band.low, at, ">", color=colour, markerfacecolor="none", markersize=5)
            continue
        # An open band ends at the cost of all runs together.
        ends = band.low, band.high if np.isfinite(band.high) else highest
        axis.plot(ends, [at, at], color=colour, lw=1.0)
        if np.isinf(band.high):
            axis.plot(ends[1], at, ">", color=colour, markersize=5)
    values, heights = [band.value for band, _ in reached], [at for _, at in reached]
    marker = MARKERS[index % len(MARKERS)]
    axis.plot(values, heights, color=colour, marker=marker, markersize=4, lw=0.8)
