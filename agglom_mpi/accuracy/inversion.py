"""The history of a campaign: what the search believed, and what its best strings are worth."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.curves import Curve, draw_curves
from agglom_mpi.accuracy.section import Section, Shown, Table
from agglom_mpi.accuracy.statistics import completed
from agglom_mpi.accuracy.trials import Trial
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.user_function import UserFunction, recorded_function
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.formatting import format_digits, format_duration, format_mean
from agglom_mpi.report.drawing import Drawing
from agglom_mpi.statistics import MeanEstimate, t_95
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.variables import NAMES

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd

Rows = NDArray[np.void]


def name_of(string: int) -> str:
    """Name of the trial that estimates a string again."""
    return f"string {string} again"


def best_strings(history: CampaignData) -> list[int]:
    """Strings that were the best after some generation, in the order they became so."""
    best = [int(row["best_string"]) for row in history.generation_rows()]
    return list(dict.fromkeys(best))


def campaign_of(history: CampaignData) -> Campaign:
    """Campaign of a file; if its objective is a function, without the code."""
    code = recorded_function(history.identity)
    return Campaign.from_text(history.campaign_text, str(history.path), code)


def trials(
    history: CampaignData, samples: int, allowed: UserFunction | None = None
) -> dict[str, Trial]:
    """Every string that was ever the best, on configurations that no decision has seen.

    Raises
    ------
    CampaignError
        If the objective is a function, and another one than is `allowed`.
    """
    campaign = campaign_of(history)
    if campaign.code is not None:
        if allowed is None or allowed.unread != campaign.code:
            message = "is a function that is not run from a file: give its unchanged campaign, too"
            raise CampaignError(Problem(campaign.name, None, "objective.call", message))
        campaign = replace(campaign, code=allowed)
    parameters = {int(row["string"]): row for row in history.string_rows()}
    return {
        name_of(string): Trial(
            campaign,
            np.array([parameters[string][name] for name in NAMES]),
            samples,
            first_sample=history.max_samples,
        )
        for string in best_strings(history)
    }


def inversion(history: CampaignData, samples: Mapping[str, Rows]) -> Section:
    """Section on the history of a campaign; `samples` as for `trials`."""
    frame = measure(history, samples)
    changes = frame[frame["string"] != frame["string"].shift()]
    again = len(samples[name_of(int(frame["string"].iloc[-1]))])
    return Section(
        title="Inversion",
        problem=(
            "A search keeps the strings whose ensembles were lucky. What did the campaign "
            f"{history.path.name} believe of its best string after each generation, and what is "
            "that string worth?"
        ),
        reference=(
            f"Each string that was ever the best, estimated again on {again} fresh configurations "
            "that no decision has seen; these estimates are unbiased."
        ),
        setups=(
            f"{len(frame)} generations, {int(frame['samples simulated'].iloc[-1])} samples, "
            f"{format_duration(float(frame['seconds (s)'].iloc[-1]))} of wall-clock time; "
            f"ensemble and "
            "search are the campaign's own."
        ),
        figures=(
            Drawing(
                "inversion",
                "Objective of the best string against time: as the search had it, and estimated "
                "again, with 95 % bands.",
                lambda figure: _draw(figure, frame),
            ),
        ),
        tables=(
            Table("inversion", "One row is one generation that changed the best.", changes, SHOWN),
            Table("inversion_history", "One row is one generation.", frame),
        ),
        failures=(),
        conclusions=tuple(_conclusions(frame)),
    )


def measure(history: CampaignData, samples: Mapping[str, Rows]) -> "pd.DataFrame":
    """One row for each generation: its best string as it was judged and as it is."""
    import pandas as pd

    campaign = campaign_of(history)
    objective = campaign.objective.build(campaign.scene.particles)
    used = {int(row["string"]): int(row["samples_used"]) for row in history.result_rows()}
    rows = []
    for row in history.generation_rows():
        string = int(row["best_string"])
        good = completed(samples[name_of(string)])
        value, error = objective.of_rows(good)
        rows.append(
            {
                "generation": int(row["generation"]),
                "seconds (s)": float(row["seconds"]),
                "samples simulated": int(row["samples_simulated"]),
                "string": string,
                "its samples": used[string],
                "objective": float(row["best_objective"]),
                "standard error": float(row["best_standard_error"]),
                "estimated again": value,
                "standard error of that": error,
                "samples of that": len(good),
            }
        )
    return pd.DataFrame(rows)


SHOWN: Final = (
    Shown("generation", lambda row: f"{row['generation'] + 1:.0f}"),
    Shown("seconds", lambda row: format_digits(row["seconds (s)"])),
    Shown("string", lambda row: f"{row['string']:.0f}"),
    Shown("its samples", lambda row: f"{row['its samples']:.0f}"),
    Shown(
        "objective, as searched",
        lambda row: format_mean(MeanEstimate(row["objective"], row["standard error"], 2)),
    ),
    Shown(
        "estimated again",
        lambda row: format_mean(
            MeanEstimate(row["estimated again"], row["standard error of that"], 2)
        ),
    ),
)


def _draw(figure: "matplotlib.figure.Figure", frame: "pd.DataFrame") -> None:
    seconds = frame["seconds (s)"]
    own = t_95(1000) * frame["standard error"]
    again = t_95(1000) * frame["standard error of that"]
    value, truth = frame["objective"], frame["estimated again"]
    curves = [
        Curve("as the search had it", seconds, value, value - own, value + own),
        Curve("estimated again", seconds, truth, truth - again, truth + again),
    ]
    draw_curves(
        figure, curves, "wall-clock time (s)", "objective of the best", scales=("linear", "linear")
    )


def _conclusions(frame: "pd.DataFrame") -> Iterator[str]:
    last = frame.iloc[-1]
    truth = MeanEstimate(last["estimated again"], last["standard error of that"], 2)
    yield (
        f"The search's last best, string {last['string']:.0f}, claims {last['objective']:.4f} ± "
        f"{last['standard error']:.4f} and is worth {format_mean(truth)}."
    )
    best = frame.iloc[int(frame["estimated again"].argmin())]
    truth = MeanEstimate(best["estimated again"], best["standard error of that"], 2)
    yield (
        f"Of all strings that were ever the best, string {best['string']:.0f} of generation "
        f"{best['generation'] + 1:.0f} has the lowest objective when estimated again, "
        f"{format_mean(truth)}, after {format_duration(float(best['seconds (s)']))}."
    )
    changes = frame[frame["string"] != frame["string"].shift()]
    optimism = changes["estimated again"] - changes["objective"]
    yield (
        f"The {len(changes)} strings that were the best are worth {optimism.mean():.4f} more on "
        "average (lower is better) than they claimed: the lucky survive."
        if optimism.mean() > 0
        else f"The {len(changes)} strings that were the best are worth no more than they claimed."
    )
