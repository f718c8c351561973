"""The best strings of a finished campaign: the search's objectives and fresh, unbiased ones."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.accuracy.report import (
    Curve,
    ReportSection,
    Sentences,
    draw_curves,
    frame_table,
    mean_column,
)
from agglom_mpi.accuracy.study import Rows, Setup, StudyPart, closed, completed
from agglom_mpi.analysis.selection_bias import CLAIMED_ERRORS
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.user_function import UserFunction
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.display.table import Column
from agglom_mpi.formatting import format_digits
from agglom_mpi.report.style import Drawing
from agglom_mpi.statistics import MeanEstimate, t_95
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_campaign

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd


def name_of(string: int) -> str:
    """Return the name of the set-up that estimates a string again."""
    return f"string {string} again"


def history_part(
    history: CampaignData, samples: int, allowed: UserFunction | None = None
) -> StudyPart:
    """Return the part on strings that were ever the best, on configurations not seen before.

    Raises
    ------
    CampaignError
        If the objective is a function and `allowed` is none or another one, or compares measured
        data, for which a study keeps too little of a sample.
    """
    campaign = recorded_campaign(history)
    if campaign.objective.needs_data:
        message = f"is {campaign.objective.name!r}; must need no measured data"
        raise CampaignError(Problem(campaign.name, None, "objective.law", message))
    if campaign.user_function is not None:
        if allowed is None or allowed.without_source != campaign.user_function.without_source:
            message = "is a function that is not run from a file: give its unchanged campaign, too"
            raise CampaignError(Problem(campaign.name, None, "objective.call", message))
        campaign = replace(campaign, user_function=allowed)
    setups = {}
    for string in dict.fromkeys(int(row["best_string"]) for row in history.generation_rows()):
        own = closed(campaign, history.parameters[string])
        setups[name_of(string)] = Setup(*own, samples, first_sample=history.max_samples)
    return StudyPart(setups, lambda found: _section(history, recorded_campaign(history), found))


def _section(
    history: CampaignData, campaign: Campaign, samples: Mapping[str, Rows]
) -> ReportSection:
    frame = measured_history(history, campaign, samples)
    changes = frame[frame["string"] != frame["string"].shift()]
    optimism = optimism_of(frame.drop_duplicates("string"))
    rounding = campaign.objective.rounding(frame["objective"])
    sentences = Sentences(
        "search_history",
        file=history.path.name,
        again=len(samples[name_of(int(frame["string"].iloc[-1]))]),
        generations=len(frame),
        last=frame.iloc[-1],
        best=frame.iloc[int(frame["estimated again"].argmin())],
        bests=frame["string"].nunique(),
        optimism=optimism,
        size=optimism._replace(value=abs(optimism.value)),
        is_bias=abs(optimism.value) > max(CLAIMED_ERRORS * optimism.error, rounding),
        estimate=lambda row: MeanEstimate(row["estimated again"], row["standard error of that"], 2),
    )
    figure = Drawing(
        "inversion",
        sentences.paragraph("caption"),
        lambda figure: _draw(figure, frame, campaign.objective.least),
    )
    caption = "One row is one generation that changed the best."
    tables = [
        frame_table(changes, caption, "inversion", HISTORY_COLUMNS),
        frame_table(frame, "One row is one generation.", "inversion_history"),
    ]
    return sentences.section("Inversion", [figure], tables)


def measured_history(
    history: CampaignData, campaign: Campaign, samples: Mapping[str, Rows]
) -> "pd.DataFrame":
    """Return for each generation its best string as the search had it, and estimated again."""
    import pandas as pd

    rows = []
    for row in history.generation_rows():
        string = int(row["best_string"])
        good = completed(samples[name_of(string)])
        value, error = campaign.objective_at(history.parameters[string]).of_rows(good)
        rows.append(
            {
                "generation": int(row["generation"]),
                "seconds (s)": float(row["seconds"]),
                "samples simulated": int(row["samples_simulated"]),
                "string": string,
                "its samples": history.samples_used[string],
                "objective": float(row["best_objective"]),
                "standard error": float(row["best_standard_error"]),
                "estimated again": value,
                "standard error of that": error,
                "samples of that": len(good),
            }
        )
    return pd.DataFrame(rows)


def optimism_of(strings: "pd.DataFrame") -> MeanEstimate:
    """Return the mean of estimates less the search's objectives, with its standard error.

    Parameters
    ----------
    strings
        Rows of `measured_history`, one for each string; their samples are independent of each
        other.
    """
    errors = strings[["standard error", "standard error of that"]]
    error = float(np.linalg.norm(errors)) / len(strings)
    difference = strings["estimated again"] - strings["objective"]
    return MeanEstimate(float(difference.mean()), error, len(strings))


HISTORY_COLUMNS: Final = (
    Column("generation", format=lambda number: f"{number + 1}"),
    Column("seconds (s)", "wall-clock s", format=format_digits),
    Column("string"),
    Column("its samples"),
    mean_column("objective, as searched", "objective", "standard error", "its samples"),
    mean_column("estimated again", "estimated again", "standard error of that", "samples of that"),
)


def _draw(figure: "matplotlib.figure.Figure", frame: "pd.DataFrame", least: float) -> None:
    """Draw both objectives against time, with bands that end at `least`, the lowest objective."""
    curves = []
    for label, column, error in (
        ("as the search had it", "objective", "standard error"),
        ("estimated again", "estimated again", "standard error of that"),
    ):
        value, half = frame[column], t_95(1000) * frame[error]
        low = np.maximum(least, value - half)
        curves.append(Curve(label, frame["seconds (s)"], value, low, value + half))
    draw_curves(
        figure, curves, "wall-clock time (s)", "objective of the best", scales=("linear", "linear")
    )
