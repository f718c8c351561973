"""The best strings of a finished campaign: the search's objectives and fresh, unbiased ones."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.accuracy.document import (
    Curve,
    ReportSection,
    ReportTable,
    Sentences,
    TableColumn,
    draw_curves,
)
from agglom_mpi.accuracy.study import Rows, Setup, closed, completed
from agglom_mpi.analysis.selection_bias import CLAIMED_ERRORS
from agglom_mpi.config.user_function import UserFunction
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.formatting import format_digits
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.statistics import MeanEstimate, t_95
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_campaign

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd


def name_of(string: int) -> str:
    """Return the name of the set-up that estimates a string again."""
    return f"string {string} again"


def best_strings(history: CampaignData) -> list[int]:
    """Return the strings that were the best after some generation, in the order they became so."""
    best = [int(row["best_string"]) for row in history.generation_rows()]
    return list(dict.fromkeys(best))


def setups(
    history: CampaignData, samples: int, allowed: UserFunction | None = None
) -> dict[str, Setup]:
    """Return a set-up for every string that was ever the best, on configurations not seen before.

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
    return {
        name_of(string): Setup(
            *closed(campaign, history.parameters[string]),
            samples,
            first_sample=history.max_samples,
        )
        for string in best_strings(history)
    }


def search_history_section(history: CampaignData, samples: Mapping[str, Rows]) -> ReportSection:
    """Return the section on the history of a campaign; `samples` are those of `setups`, by name."""
    frame = measure(history, samples)
    changes = frame[frame["string"] != frame["string"].shift()]
    optimism = optimism_of(frame.drop_duplicates("string"))
    rounding = campaign_objective(history).rounding(frame["objective"])
    again = len(samples[name_of(int(frame["string"].iloc[-1]))])
    sentences = Sentences(
        "search_history",
        file=history.path.name,
        again=again,
        generations=len(frame),
        last=frame.iloc[-1],
        best=frame.iloc[int(frame["estimated again"].argmin())],
        bests=frame["string"].nunique(),
        optimism=optimism,
        size=optimism._replace(value=abs(optimism.value)),
        is_bias=abs(optimism.value) > max(CLAIMED_ERRORS * optimism.error, rounding),
        estimate=lambda row: MeanEstimate(row["estimated again"], row["standard error of that"], 2),
    )
    return sentences.section(
        title="Inversion",
        figures=(
            Drawing(
                "inversion",
                sentences.paragraph("caption"),
                lambda figure: _draw(figure, frame, campaign_objective(history).least),
            ),
        ),
        tables=(
            ReportTable(
                "inversion", "One row is one generation that changed the best.", changes, COLUMNS
            ),
            ReportTable("inversion_history", "One row is one generation.", frame),
        ),
    )


def measure(history: CampaignData, samples: Mapping[str, Rows]) -> "pd.DataFrame":
    """Return for each generation its best string as the search had it, and estimated again."""
    import pandas as pd

    campaign, rows = recorded_campaign(history), []
    for row in history.generation_rows():
        string = int(row["best_string"])
        good = completed(samples[name_of(string)])
        objective = campaign.objective_at(history.parameters[string])
        value, error = objective.of_rows(good)
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


def campaign_objective(history: CampaignData) -> Objective:
    """Return the objective that the campaign of a file searched by."""
    return recorded_campaign(history).objective


def optimism_of(strings: "pd.DataFrame") -> MeanEstimate:
    """Return the mean of estimates less the search's objectives, with its standard error.

    Parameters
    ----------
    strings
        Rows of `measure`, one for each string; their samples are independent of each other.
    """
    errors = strings[["standard error", "standard error of that"]]
    error = float(np.linalg.norm(errors)) / len(strings)
    difference = strings["estimated again"] - strings["objective"]
    return MeanEstimate(float(difference.mean()), error, len(strings))


COLUMNS: Final = (
    TableColumn("generation", lambda row: f"{row['generation'] + 1:.0f}"),
    TableColumn("wall-clock s", lambda row: format_digits(row["seconds (s)"])),
    TableColumn.number("string", ".0f"),
    TableColumn.number("its samples", ".0f"),
    TableColumn.mean("objective, as searched", "objective", "standard error", "its samples"),
    TableColumn.mean(
        "estimated again", "estimated again", "standard error of that", "samples of that"
    ),
)


def _draw(figure: "matplotlib.figure.Figure", frame: "pd.DataFrame", least: float) -> None:
    """Draw both objectives against time, with bands that end at `least`, the lowest objective."""
    seconds = frame["seconds (s)"]
    own = t_95(1000) * frame["standard error"]
    again = t_95(1000) * frame["standard error of that"]
    value, truth = frame["objective"], frame["estimated again"]
    curves = [
        Curve("as the search had it", seconds, value, np.maximum(least, value - own), value + own),
        Curve("estimated again", seconds, truth, np.maximum(least, truth - again), truth + again),
    ]
    draw_curves(
        figure, curves, "wall-clock time (s)", "objective of the best", scales=("linear", "linear")
    )
