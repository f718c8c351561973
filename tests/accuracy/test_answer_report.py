"""Tables, sentences and figures of an answer study, of made-up answers."""

import itertools
import math

import numpy as np
import pandas as pd
import pytest
from accuracy_rows import frame_of
from matplotlib.figure import Figure

from agglom_mpi.accuracy.answer.answer_report import (
    answer_section,
    draw_factor,
    expected_times,
    times_of,
)
from agglom_mpi.accuracy.answer.errors import COST_SAMPLES, COST_SECONDS, Answers
from agglom_mpi.config.answer_study import load_answer_study


@pytest.fixture(scope="module")
def study():
    found = load_answer_study("jobs/accuracy/answer_quick.yaml")
    return found._replace(targets=(0.5, 0.1, 0.01), compared=0.1)


def answers(study, errors):
    """Return answers with these errors after 10, 20, 30 samples, by setting and seed."""
    rows = [
        {
            "factor": setting.factor,
            "setting": setting.name,
            "seed": seed,
            "generation": generation,
            COST_SAMPLES: 10 * (generation + 1),
            COST_SECONDS: 0.5 * (generation + 1),
            "error": error,
            "bound": error,
        }
        for setting in study.settings
        for seed, run in enumerate(errors[setting.name], 1)
        for generation, error in enumerate(run)
    ]
    return Answers(pd.DataFrame(rows), "Λ", "a reference", 0.05)


ERRORS = {
    "default": [[0.4, 0.09, 0.2], [0.4, 0.3, 0.05]],
    "Sobol points": [[0.6, 0.4, 0.3], [0.6, 0.1, 0.09]],
}


def test_expected_times_are_those_of_the_first_answers_within_a_target(study):
    frame = expected_times(study, times_of(study, answers(study, ERRORS)))
    found = frame.set_index(["setting", "target"])[f"expected {COST_SAMPLES}"]
    assert found["default", 0.5] == 10
    assert found["default", 0.1] == (20 + 30) / 2
    assert found["Sobol points", 0.5] == 20
    assert found["Sobol points", 0.1] == (30 + 20) / 1
    assert math.isinf(found["default", 0.01])
    seconds = frame.set_index(["setting", "target"])[f"expected {COST_SECONDS}"]
    assert seconds["Sobol points", 0.1] == 2.5


def test_a_section_has_all_targets_that_are_resolved_or_says_which_are_not(study):
    made = answers(study, ERRORS)
    section = answer_section(study, made, times_of(study, made))
    assert section.failures == ("Targets below the resolution of 0.05: 0.01.",)
    assert [figure.name for figure in section.figures] == ["answer_searches"]
    tables = {table.name: table for table in section.tables}
    assert set(tables) == {"answers", "expected_run_times", "compared"}
    assert "1 of 2 runs reach an error of 0.1" in section.conclusions[1]
    assert len(section.conclusions) == len(frame_of(tables["compared"])) == len(study.settings)
    for table in tables.values():
        assert not table.columns or all(all(line[1:]) for line in table.cells)


def test_labels_of_a_figure_do_not_overlap(study):
    # Long names of seven settings.
    names = [f"setting number {i} with a name" for i in range(7)]
    settings = [s._replace(name=n) for s, n in zip([study.settings[1]] * 7, names, strict=True)]
    many = study._replace(settings=tuple(settings))
    made = answers(many, dict.fromkeys(names, ERRORS["default"]))
    figure = Figure(figsize=(9.0, 7.4), dpi=110, layout="constrained")
    times = dict(zip(names, times_of(many, made), strict=True))
    draw_factor(figure, times, many.targets, "Λ above its floor")
    figure.draw_without_rendering()
    [legend] = figure.legends
    box = legend.get_window_extent()
    assert box.x0 >= 0.0
    assert box.x1 <= figure.bbox.x1
    assert all(not box.overlaps(axes.get_tightbbox()) for axes in figure.axes)
    for axes in figure.axes:
        boxes = [t.get_window_extent() for t in axes.get_xticklabels() if t.get_text()]
        inside = [b for b in boxes if b.x1 > axes.bbox.x0 and b.x0 < axes.bbox.x1]
        assert all(a.x1 <= b.x0 + 1e-6 for a, b in itertools.pairwise(inside))


def test_shares_of_a_figure_rise_to_those_of_the_runs(study):
    figure = Figure()
    times = times_of(study, answers(study, ERRORS))
    draw_factor(figure, dict(zip(ERRORS, times, strict=True)), study.targets, "Λ")
    for line, each in zip(figure.axes[0].lines[::2], times, strict=True):
        shares = np.asarray(line.get_ydata(), float)
        assert (np.diff(shares) >= 0).all()
        assert shares[-1] == each[COST_SAMPLES].share([1e9])[0]
