"""Errors of the answers of all runs of a study, by samples that no run has used."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.answer_runs import AnswerHistory, AnswerRun, history_of, runs_of
from agglom_mpi.accuracy.answer_sets import (
    MembershipStudy,
    box_points,
    kept_set,
    true_set,
)
from agglom_mpi.accuracy.fresh_estimates import (
    FreshEstimates,
    estimate_of,
    floor_of,
    fresh_setups,
    upper_bound,
)
from agglom_mpi.accuracy.study import Study
from agglom_mpi.config.answer_study import AnswerStudy
from agglom_mpi.storage.reader import CampaignData, read_inversion

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

SAMPLES: Final = "samples"
SECONDS: Final = "processor time (s)"
"""Columns of the two costs."""


class Answers(NamedTuple):
    """Errors of all answers of a study.

    Attributes
    ----------
    frame
        One row is the answer of a run after a generation: `factor`, `setting`, `seed`,
        `generation`, `samples`, `processor time (s)`, `error`, and `bound`, which is compared with
        the targets.
    quantity
        Name of the error.
    reference
        One line on what the errors are measured against.
    resolution
        Error below which answers are not distinguished.
    """

    frame: "pd.DataFrame"
    quantity: str
    reference: str
    resolution: float


def estimation(study: AnswerStudy, folder: Path) -> Study:
    """Return the samples that tell the errors of the answers of finished runs."""
    if study.answer == "set":
        return MembershipStudy(study, fresh_setups(study, box_points(study)))
    strings = distinct(history for _, history in histories(study, folder))
    return FreshEstimates(study.question, fresh_setups(study, strings.values()))


def histories(study: AnswerStudy, folder: Path) -> Iterator[tuple[AnswerRun, AnswerHistory]]:
    """Yield all runs, which are finished, with their histories."""
    for run in runs_of(study, folder):
        yield run, history_of(run, read_inversion(run.path, allow_code=True))


def distinct(found: Iterable[AnswerHistory]) -> dict[bytes, Floats]:
    """Return the different strings, (k,), that were the best of any run after any generation."""
    return {string.tobytes(): string for history in found for string in history.best}


def answers_of(study: AnswerStudy, folder: Path, file: CampaignData) -> Answers:
    """Return the errors of all answers by the samples of `estimation`, which are in a file."""
    if study.answer == "set":
        return _sets(study, folder, file)
    return _best_strings(study, folder, file)


def _best_strings(study: AnswerStudy, folder: Path, file: CampaignData) -> Answers:
    import pandas as pd

    objective, runs = study.question.objective, list(histories(study, folder))
    strings = distinct(history for _, history in runs)
    samples = [file.sample_rows(number) for number in range(len(strings))]
    estimates = [estimate_of(objective, rows) for rows in samples]
    floor = floor_of(objective, samples)
    number = {key: place for place, key in enumerate(strings)}
    frames = []
    for run, history in runs:
        own = [number[string.tobytes()] for string in history.best]
        columns = {
            "string": own,
            "claimed": history.claimed,
            "re-estimate": [estimates[i].value for i in own],
            "standard error": [estimates[i].error for i in own],
            "error": [estimates[i].value - floor.value for i in own],
            "bound": [upper_bound(estimates[i], floor) for i in own],
        }
        generations = np.arange(len(own))
        frames.append(_frame(run, generations, history.samples, history.seconds, columns))
    symbol = objective.symbol or "objective"
    name = symbol if floor.value == 0.0 else f"{symbol} above its floor"
    errors = [estimate.error for estimate in estimates if np.isfinite(estimate.error)]
    reference = (
        f"{len(strings)} different best strings, each on {study.samples} fresh samples; a target "
        f"is reached where the one-sided 95 % bound of the error is within it"
    )
    if floor.error > 0.0:
        reference += f"; floor {floor.value:.4f} ± {floor.error:.4f}"
    resolution = float(2.0 * np.median(errors)) if errors else 0.0
    return Answers(pd.concat(frames, ignore_index=True), name, reference, resolution)


def _sets(study: AnswerStudy, folder: Path, file: CampaignData) -> Answers:
    import pandas as pd

    points = len(box_points(study))
    truth = true_set(study, [file.sample_rows(number) for number in range(points)])
    frames = []
    for run in runs_of(study, folder):
        recorded = read_inversion(run.path, allow_code=True)
        history, found = history_of(run, recorded), kept_set(run, study, recorded)
        errors, at = truth.errors(found.members), found.generation
        columns = {"members": found.members.sum(axis=1), "error": errors, "bound": errors}
        frames.append(_frame(run, at, history.samples[at], history.seconds[at], columns))
    reference = (
        f"{int(truth.members.sum())} of {points} even points of the box are members, by up to "
        f"{study.samples} samples of each; an exact set would show an error of "
        f"{truth.resolution:.2g}"
    )
    name = "relative error of the set"
    return Answers(pd.concat(frames, ignore_index=True), name, reference, truth.resolution)


def _frame(
    run: AnswerRun,
    generations: NDArray[np.int64],
    samples: NDArray[np.int64],
    seconds: Floats,
    columns: dict[str, object],
) -> "pd.DataFrame":
    """Return the rows of one run."""
    import pandas as pd

    return pd.DataFrame(
        {
            "factor": run.setting.factor,
            "setting": run.setting.name,
            "seed": run.seed,
            "generation": generations,
            SAMPLES: samples,
            SECONDS: seconds,
            **columns,
        }
    )


def runs_in(frame: "pd.DataFrame", cost: str) -> Iterator[tuple[Floats, Floats]]:
    """Yield costs and bounds of each run in rows of answers of one setting."""
    for _, rows in frame.groupby("seed", sort=True):
        yield rows[cost].to_numpy(np.float64), rows["bound"].to_numpy(np.float64)


def answers_by_setting(answers: Answers, study: AnswerStudy) -> "Sequence[pd.DataFrame]":
    """Return the rows of each setting, in the order of the study."""
    frame = answers.frame
    return [
        frame[(frame["factor"] == setting.factor) & (frame["setting"] == setting.name)]
        for setting in study.settings
    ]
