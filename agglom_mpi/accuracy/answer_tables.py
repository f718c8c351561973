"""Tables of an answer study: expected run times of all settings, and one sentence on each."""

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from agglom_mpi.accuracy.answer_errors import (
    SAMPLES,
    SECONDS,
    Answers,
    answers_by_setting,
    runs_in,
)
from agglom_mpi.accuracy.times_to_targets import Band, TimesToTargets
from agglom_mpi.config.answer_study import DEFAULT, AnswerStudy, Setting
from agglom_mpi.formatting import format_digits, format_seconds

if TYPE_CHECKING:
    import pandas as pd

COSTS: Final = (SAMPLES, SECONDS)
"""The costs, as columns name them."""
BOOTSTRAP_SEED: Final = 46
"""Seed of the resampling of runs, so that a report is the same each time."""


class SettingTimes(NamedTuple):
    """A setting, and its costs to each target in samples and in processor seconds."""

    setting: Setting
    samples: TimesToTargets
    seconds: TimesToTargets

    def by(self, cost: str) -> TimesToTargets:
        """Return the times in one of the costs."""
        return self.samples if cost == SAMPLES else self.seconds


def times_of(study: AnswerStudy, answers: Answers) -> list[SettingTimes]:
    """Return the times of all settings, the default first."""
    found = []
    for setting, frame in zip(study.settings, answers_by_setting(answers, study), strict=True):
        times = []
        for cost in COSTS:
            costs, errors = zip(*runs_in(frame, cost), strict=True)
            times.append(TimesToTargets.of_runs(list(costs), list(errors), study.targets))
        found.append(SettingTimes(setting, *times))
    return found


def expected_times(study: AnswerStudy, times: list[SettingTimes]) -> "pd.DataFrame":
    """Return the expected run times of each setting and target, with bands and ratios."""
    import pandas as pd

    default, rows = times[0], []
    for each in times:
        random = np.random.default_rng(BOOTSTRAP_SEED)
        bands = [each.by(cost).band(random) for cost in COSTS]
        ratios = [each.by(cost).relative_to(default.by(cost), random) for cost in COSTS]
        for place, target in enumerate(study.targets):
            row: dict[str, object] = {
                "factor": each.setting.factor,
                "setting": each.setting.name,
                "target": target,
                "runs": each.samples.runs,
                "runs that reach it": int(each.samples.successes[place]),
            }
            for cost, band, ratio in zip(COSTS, bands, ratios, strict=True):
                row |= _columns(f"expected {cost}", band[place])
                row |= _columns(f"{cost}, relative to the default", ratio[place])
            rows.append(row)
    return pd.DataFrame(rows)


def _columns(name: str, band: Band) -> dict[str, float]:
    return {name: band.value, f"{name}, low": band.low, f"{name}, high": band.high}


def last_answers(study: AnswerStudy, answers: Answers) -> "pd.DataFrame":
    """Return the error of the last answer of each setting over its runs: mean, least and most."""
    import pandas as pd

    rows = []
    for setting, frame in zip(study.settings, answers_by_setting(answers, study), strict=True):
        last = frame.groupby("seed").last()
        within = float((last["bound"] <= study.compared).mean())
        rows.append(
            {
                "factor": setting.factor,
                "setting": setting.name,
                "error, mean": last["error"].mean(),
                "error, least": last["error"].min(),
                "error, most": last["error"].max(),
                "last answer within the target": within,
                **{f"{cost}, mean": last[cost].mean() for cost in COSTS},
            }
        )
    return pd.DataFrame(rows)


def band_text(band: Band, form: str = "number") -> str:
    """Return a band as text: `310 (250 to 420)`; a ratio has the form `ratio`, seconds `time`."""
    if math.isnan(band.value):
        return "unknown"
    value, low, high = ("∞" if math.isinf(end) else _number(end, form) for end in band)
    return f"more than {low}" if math.isinf(band.value) else f"{value} ({low} to {high})"


def _number(value: float, form: str) -> str:
    if form == "time":
        return format_seconds(value)
    return format_digits(value) if form == "ratio" else f"{value:.0f}"


def verdict(ratio: Band, cost: str) -> str:
    """Return what a ratio of expected costs says, as a clause; it is resolved if its band is."""
    what = "samples" if cost == SAMPLES else "processor time"
    if math.isnan(ratio.value):
        return f"{what}: not compared"
    text = band_text(ratio, "ratio")
    if ratio.value == 0.0:
        text = f"less than {_number(ratio.high, 'ratio')}"
    found = "more" if ratio.low > 1.0 else "less" if ratio.high < 1.0 else "not resolved"
    return f"{what}: {text} × the default's, {found}"


def sentence(study: AnswerStudy, each: SettingTimes, default: SettingTimes) -> str:
    """Return one sentence on a setting at the compared target."""
    place = study.targets.index(study.compared)
    random = np.random.default_rng(BOOTSTRAP_SEED)
    count = f"{each.samples.successes[place]} of {each.samples.runs} runs reach it"
    if each.setting.name == DEFAULT:
        return f"{count}."
    clauses = [
        verdict(each.by(cost).at(place).relative_to(default.by(cost).at(place), random)[0], cost)
        for cost in COSTS
    ]
    return f"{count}; {'; '.join(clauses)}."
