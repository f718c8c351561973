"""Errors of the answers of all runs of a study, by samples that no run has used."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.answer.runs import (
    CLEAR_ERRORS,
    MIN_SAMPLES,
    AnswerHistory,
    AnswerRun,
    ClearMembership,
    box_points,
    history_of,
    runs_of,
    sets_of,
    true_set,
)
from agglom_mpi.accuracy.study import Rows, Setup, Study, closed, completed
from agglom_mpi.config.answer_study import AnswerStudy
from agglom_mpi.config.identity import STUDY_SEPARATORS, digest
from agglom_mpi.runtime.experiment import SampleSetup
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.statistics import MeanEstimate, too_many_failed
from agglom_mpi.storage.reader import CampaignData, read_inversion
from agglom_mpi.storage.room import table_sizes

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

COST_SAMPLES: Final = "samples"
COST_SECONDS: Final = "processor time (s)"
"""Columns of the two costs."""
BOUND_ERRORS: Final = 1.6449
"""Standard errors from an estimate to its one-sided 95 % bound."""


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

    def by_setting(self, study: AnswerStudy) -> "Sequence[pd.DataFrame]":
        """Return the rows of each setting, in the order of the study."""
        frame = self.frame
        return [
            frame[(frame["factor"] == setting.factor) & (frame["setting"] == setting.name)]
            for setting in study.settings
        ]


class FreshSamples(Study):
    """Thousands of strings in the scene of a question, on samples that no run has used.

    All samples of a best string are simulated, and those of a point of a box until it is clearly in
    the set or out of it.
    """

    def __init__(self, study: AnswerStudy, strings: Iterable[Floats]) -> None:
        super().__init__(study.question, fresh_setups(study, strings), math.inf)
        self.membership: ClearMembership | None = None
        if study.answer == "set":
            fewest = min(MIN_SAMPLES, study.samples)
            self.membership = ClearMembership(
                tolerance=study.tolerance, max_samples=study.samples, min_samples=fewest
            )

    def identity(self) -> dict[str, object]:
        """Return the campaign's own, one digest of all set-ups, and what ends them."""
        each = [setup.sha256() for setup in self.setups.values()]
        entries = self.campaign.identity() | {"strings": len(each)}
        entries["setups"] = digest({"all": each}, STUDY_SEPARATORS)
        if self.membership is not None:
            entries["rule.tolerance"], entries["rule.errors"] = (
                self.membership.tolerance,
                CLEAR_ERRORS,
            )
            entries["rule.min_samples"] = self.membership.min_samples
        return entries

    def kernel_cases(self) -> Iterator[tuple[SampleSetup, Floats]]:
        """Yield the first set-up: all are of one scene."""
        yield next(super().kernel_cases())

    def ensemble(self, string: int) -> Ensemble:
        """Return what takes the samples of a string."""
        if self.membership is None:
            return super().ensemble(string)
        campaign = self._by_string[string].campaign
        return Ensemble(self.membership, campaign.objective, campaign.scene.particles)


def estimation(study: AnswerStudy, folder: Path) -> FreshSamples:
    """Return the samples that tell the errors of the answers of finished runs."""
    if study.answer == "set":
        return FreshSamples(study, box_points(study))
    strings = distinct(history for _, history in histories(study, folder))
    return FreshSamples(study, strings.values())


def first_fresh_sample(study: AnswerStudy) -> int:
    """Return the number of the first sample that no run of a study can have used."""
    sizes = [table_sizes(setting.campaign) for setting in study.settings]
    return max(size.max_samples + size.fresh for size in sizes)


def fresh_setups(study: AnswerStudy, strings: Iterable[Floats]) -> dict[str, Setup]:
    """Return a set-up of each string, (k,), in the scene of the question, by number."""
    first = first_fresh_sample(study)
    return {
        str(number): Setup(*closed(study.question, string), study.samples, first_sample=first)
        for number, string in enumerate(strings)
    }


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
        frames.append(_frame(run, history, np.arange(len(own)), columns))
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
    return Answers(_joined(frames), name, reference, resolution)


def _sets(study: AnswerStudy, folder: Path, file: CampaignData) -> Answers:
    points = box_points(study)
    truth = true_set(study, [file.sample_rows(number) for number in range(len(points))])
    frames = []
    for run in runs_of(study, folder):
        recorded = read_inversion(run.path, allow_code=True)
        found = sets_of(run, study, points, recorded)
        errors = truth.errors(found.members)
        columns = {"members": found.members.sum(axis=1), "error": errors, "bound": errors}
        frames.append(_frame(run, history_of(run, recorded), found.generation, columns))
    reference = (
        f"{int(truth.members.sum())} of {len(points)} even points of the box are members, by up to "
        f"{study.samples} samples of each; an exact set would show an error of "
        f"{truth.resolution:.2g}"
    )
    return Answers(_joined(frames), "relative error of the set", reference, truth.resolution)


def _frame(
    run: AnswerRun,
    history: AnswerHistory,
    generations: NDArray[np.int64],
    columns: Mapping[str, object],
) -> dict[str, object]:
    return {
        "factor": run.setting.factor,
        "setting": run.setting.name,
        "seed": run.seed,
        "generation": generations,
        COST_SAMPLES: history.samples[generations],
        COST_SECONDS: history.seconds[generations],
        **columns,
    }


def _joined(frames: Iterable[dict[str, object]]) -> "pd.DataFrame":
    import pandas as pd

    return pd.concat(map(pd.DataFrame, frames), ignore_index=True)


def estimate_of(objective: Objective, rows: Rows) -> MeanEstimate:
    """Return the objective of samples; inf, like an ensemble's, if too many of them failed."""
    good = completed(rows)
    if too_many_failed(len(rows) - len(good), len(rows)):
        return MeanEstimate(np.inf, np.nan, len(good))
    return MeanEstimate(*objective.of_rows(good), len(good))


def floor_of(objective: Objective, samples: Iterable[Rows]) -> MeanEstimate:
    """Return the lowest objective: that of the target, or of the best of strings that are known.

    Where there is no target, the string is chosen by every other sample and estimated by the rest:
    the lowest of many estimates is too low.

    Parameters
    ----------
    objective
    samples
        Of each string.
    """
    if objective.has_target:
        return MeanEstimate(objective.least, 0.0, 0)
    halves = [(rows[::2], rows[1::2]) for rows in samples]
    chosen = min(halves, key=lambda pair: estimate_of(objective, pair[0]).value)
    return estimate_of(objective, chosen[1])


def upper_bound(estimate: MeanEstimate, floor: MeanEstimate) -> float:
    """Return the one-sided 95 % bound of an objective above the floor; inf without an estimate.

    An answer that is within a target by this bound is not so by the luck of its re-estimate.
    """
    error = 0.0 if estimate.error == 0.0 else estimate.error
    bound = estimate.value + BOUND_ERRORS * error - floor.value
    return float(bound) if np.isfinite(bound) else np.inf
