"""The report on disc."""

from itertools import pairwise

import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread

from agglom_mpi.accuracy.report import (
    Curve,
    ReportSection,
    RowColumn,
    draw_curves,
    frame_table,
    write_document,
)
from agglom_mpi.report.style import DOTS_PER_INCH, SIZE, Drawing

FRAME = pd.DataFrame({"step (s)": [0.1, 0.01], "error": [1.0 / 3.0, 0.0]})


def draw(figure):
    draw_curves(
        figure, [Curve("one", [1, 2], [3, 4], [2, 3], [4, 5]), Curve("two", [1], [1])], "s", "%"
    )


SECTION = ReportSection(
    title="Steps",
    problem="What do steps cost?",
    reference="None.",
    setups="Two.",
    figures=(Drawing("steps", "Error against steps.", draw),),
    tables=(
        frame_table(
            FRAME,
            "One row is one step.",
            "steps",
            (RowColumn("step", format=lambda row: f"{row['step (s)']}|"),),
        ),
        frame_table(FRAME, "Not shown.", "hidden"),
    ),
    failures=("The first one failed.",),
    conclusions=("Steps cost time.",),
)


@pytest.fixture
def written(tmp_path):
    facts = ("agglom accuracy x.yaml", "two set-ups")
    return write_document(tmp_path, "Accuracy", facts, {"Error against run time": [SECTION]})


def test_the_document_tells_problem_reference_failures_and_conclusions(written):
    text = written.read_text()
    for line in (
        "# Accuracy",
        "`agglom accuracy x.yaml`",
        "- two set-ups",
        "## Part 1: Error against run time",
        "### Steps",
        "What do steps cost?",
        "**Reference.** None.",
        "![Error against steps.](steps.png)",
        "| step |",
        "| 0.01¦ |",
        "- The first one failed.",
        "- Steps cost time.",
        "## Machine",
    ):
        assert line in text.splitlines(), line
    assert text.index("Steps cost time.") < text.index("## Part 1")


def test_every_number_is_in_a_csv_unrounded(written):
    for name in ("steps", "hidden"):
        read = pd.read_csv(written.parent / f"{name}.csv", dtype=str)
        for column in FRAME.columns:
            assert [float(text) for text in read[column]] == FRAME[column].tolist()
    assert "Not shown." not in written.read_text()


def test_figures_are_there_as_pictures_and_vectors(written):
    assert imread(written.parent / "steps.png").shape[:2] == (700, 1100)
    assert "<svg" in (written.parent / "steps.svg").read_text()
    assert (written.parent / "steps.png").stat().st_size < 100_000


def test_no_half_written_file_is_left_behind(written):
    assert sorted(path.name for path in written.parent.iterdir()) == [
        "hidden.csv",
        "report.md",
        "steps.csv",
        "steps.png",
        "steps.svg",
    ]


@pytest.mark.parametrize("upper", [1.3, 4.0, 35.0, 2e6])
@pytest.mark.parametrize("lower", [0.0031, 0.7])
def test_labels_of_an_axis_of_times_do_not_overlap(lower, upper):
    figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH, layout="constrained")
    curve = Curve("one", [lower, lower * upper], [1.0, 2.0])
    axes = draw_curves(figure, [curve], "time per sample (s)", "error")
    FigureCanvasAgg(figure).draw()
    labels = [t for which in ("major", "minor") for t in axes.xaxis.get_ticklabels(which=which)]
    inside = [t.get_window_extent() for t in labels if t.get_text()]
    left, right = axes.get_window_extent().intervalx
    boxes = sorted((b.x0, b.x1) for b in inside if left <= (b.x0 + b.x1) / 2 <= right)
    assert len(boxes) >= 2
    assert all(end < begin for (_, end), (begin, _) in pairwise(boxes))
