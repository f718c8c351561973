"""Samples that public optimisers and our searches need for an answer, scored by the same rule.

`python tests/benchmarks/bench_peers.py QUESTION SEEDS [NAME ...]`, with the question `accretion`
(jobs/accuracy/answer_accretion_2003.yaml), `agglomeration` (answer_agglomeration_2004.yaml) or
`three` (answer_doubling_in_three.yaml, whose answer is a set). Without names, all methods run; one
whose library is not installed is skipped. `optimiser_peers.py` says how peers are set up.

Peers are given the unit cube, one string at a time, and the objective of new samples of each by
`simulate_many`: of one sample, or, with "5 a string", of five, all of which are counted. As in
`agglom accuracy --answer`, the answer after some samples is the string that the method itself would
report then. Peers are asked for it after every 24 samples, a batch of the surrogate. It is
estimated on the fresh samples of the study, and is right if the one-sided 95 % bound of its error
is within the compared target; one that is clearly wrong by some of them is estimated no further.
A run ends with a right answer or after its samples, which are fewer for peers that think for long:
expected numbers of samples are those of runs that are begun again.

For `three` a peer needs a model that predicts a set. That of scikit-optimize predicts the
objective, hence ten samples of each string. scikit-learn's Gaussian process of mean b/b0 at even
points, one sample each, is what one would write without any search. Samples are counted where sets
are made, at 1.5 times as many each.
"""

import importlib.util
import json
import sys
import tempfile
import time
import warnings
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from bench_feasible_set import campaign_file, simulated
from bench_search import FRESH, generations_of
from numpy.typing import NDArray
from optimiser_peers import (
    BATCH,
    METHODS,
    SAMPLES,
    SEED_STEP,
    SkoptPeer,
    objective_of,
    reported,
)
from scipy.stats import qmc

from agglom_mpi.accuracy.answer.answer_report import BOOTSTRAP_SEED, band_text
from agglom_mpi.accuracy.answer.errors import upper_bound
from agglom_mpi.accuracy.answer.runs import CLEAR_ERRORS, LADDER, MIN_SAMPLES, evolving_set
from agglom_mpi.accuracy.answer.times_to_targets import TimesToTargets
from agglom_mpi.config.answer_study import DEFAULT, AnswerStudy, load_answer_study
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.outcome import OUTCOME
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.statistics import MeanEstimate
from agglom_mpi.verbs.simulate_many import simulate_many

Floats = NDArray[np.float64]
Members = NDArray[np.bool_]
Run = tuple[list[float], list[float]]
"""Samples of a run so far, and the errors of the answers that it has then."""

STUDIES: Final = Path(__file__).parents[2] / "jobs" / "accuracy"
QUESTIONS: Final = {
    "accretion": "answer_accretion_2003",
    "agglomeration": "answer_agglomeration_2004",
    "three": "answer_doubling_in_three",
}
SMALL: Final = "surrogate, batches of 4"
OURS: Final = (DEFAULT, SMALL, "CMA-ES", "genetic", "Sobol points")
"""Our searches for the best string: settings of the studies, whose default is the surrogate."""
SETS: Final = {
    DEFAULT: "",
    "surrogate with aim set": "",
    "Sobol points": "",
    "scikit-optimize, 10 a string": "skopt",
    "scikit-learn at even points": "sklearn",
}
"""What gives a set, and the library that it needs."""
FLOOR: Final = MeanEstimate(0.6008, 0.0050, 100)
"""Lowest objective of the question of 2004, as the report of its study has it."""
SEEDS: Final = 5
POINTS: Final = 2048
"""Number of points at which sets are compared."""
PER_STRING: Final = 10
"""Samples of a string where the model of the objective predicts a set."""


def ours(study: AnswerStudy, name: str, seed: int) -> Iterator[tuple[int, Floats]]:
    """Yield what `reported` does, of one of our searches."""
    campaign, last = (
        setting_of(study, DEFAULT if name == SMALL else name).campaign.with_seed(seed),
        0,
    )
    if name == SMALL:
        search = {"method": "surrogate", "initial": 10, "batch": 4}
        plan = {"search": search, "stopping": {"generations": SAMPLES}}
        campaign = Campaign.from_text(json.dumps(json.loads(campaign.text) | plan))
    for used, (best, *_) in generations_of(campaign, SAMPLES):
        if used >= last + BATCH or name != SMALL:
            last = used
            yield used, best


def bound_of(study: AnswerStudy, string: Floats) -> float:
    """Return the one-sided bound of the error of a string on fresh samples."""
    objective, rows = study.question.objective, np.zeros(0, OUTCOME)
    floor = MeanEstimate(objective.least, 0.0, 0) if objective.has_target else FLOOR
    for samples in (study.samples // 20, study.samples // 4, study.samples):
        more = simulated(study.question, string, FRESH + len(rows), samples - len(rows))
        rows = np.concatenate((rows, more))
        estimate = MeanEstimate(*objective.of_rows(rows), len(rows))
        if estimate.value - CLEAR_ERRORS * estimate.error > floor.value + study.compared:
            break
    return upper_bound(estimate, floor)


def run_best(study: AnswerStudy, name: str, seed: int) -> Run:
    """Return samples and errors of the answers of one run, up to the first right one."""
    of_peer = METHODS.get(name)
    answers = reported(of_peer, study, seed) if of_peer else ours(study, name, seed)
    samples, errors, known = [], [], dict[bytes, float]()
    for used, string in answers:
        key = string.tobytes()
        known[key] = known[key] if key in known else bound_of(study, string)
        samples.append(float(used))
        errors.append(known[key])
        if errors[-1] <= study.compared:
            break
    return samples, errors


def setting_of(study: AnswerStudy, name: str) -> Any:
    return next(setting for setting in study.settings if setting.name == name)


@cache
def true_set() -> tuple[Floats, Members]:
    """Return even points of the box, (n, k), and which are members, by samples of their own."""
    study = study_of("three")
    points, members = SearchedBox(study.question).allowed_even_strings(POINTS), []
    for point in points:
        rows = np.zeros(0, OUTCOME)
        for samples in (MIN_SAMPLES, 4 * MIN_SAMPLES, study.samples):
            more = simulated(study.question, point, FRESH + len(rows), samples - len(rows))
            rows = np.concatenate((rows, more))
            value, error = study.question.objective.of_rows(rows)
            if abs(value - study.tolerance) > CLEAR_ERRORS * error:
                break
        members.append(value <= study.tolerance)
    return points, np.array(members)


def predicted_by_skopt(study: AnswerStudy, seed: int) -> Iterator[tuple[int, Members]]:
    """Yield samples and members where the process of scikit-optimize expects the objective."""
    space = SearchSpace.of(study.question.variables)
    peer, at = SkoptPeer(space.dimensions, seed), space.to_unit(true_set()[0])
    for string in range(SAMPLES // PER_STRING):
        first, asked = seed * SEED_STEP + string * PER_STRING, space.from_unit(peer.ask()[None])
        peer.tell(objective_of(study, asked, PER_STRING, first))
        if string >= 10:  # it begins with ten random points
            yield (string + 1) * PER_STRING, peer.predicted(at) <= study.tolerance


def predicted_by_sklearn(study: AnswerStudy, seed: int) -> Iterator[tuple[int, Members]]:
    """Yield samples and members by a process of mean b/b0 at even points."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    space = SearchSpace.of(study.question.variables)
    even, at = qmc.Sobol(space.dimensions, seed=seed).random(512), space.to_unit(true_set()[0])
    found = simulate_many(
        study.question, space.from_unit(even[:SAMPLES]), workers=1, first_sample=seed * SEED_STEP
    )
    kernel = ConstantKernel() * Matern(np.ones(space.dimensions), nu=2.5) + WhiteKernel(0.1)
    for step in count():
        used = int(32 * LADDER**step)
        if used > SAMPLES:
            return
        process = GaussianProcessRegressor(kernel, normalize_y=True)
        mean = process.fit(even[:used], found.mean_radius_ratio[:used, 0]).predict(at)
        yield used, np.abs(mean / 2.0 - 1.0) <= study.tolerance


def run_set(study: AnswerStudy, name: str, seed: int) -> Run:
    """Return samples and relative errors of the sets of one run."""
    points, members = true_set()
    sets: Iterable[tuple[int, Members]]
    if SETS[name]:
        by = predicted_by_skopt if SETS[name] == "skopt" else predicted_by_sklearn
        sets = by(study, seed)
    else:
        data = json.loads(setting_of(study, name).campaign.with_seed(seed).text)
        data["stopping"] = {"generations": SAMPLES // 16}
        with tempfile.TemporaryDirectory() as folder:
            file = campaign_file(Path(folder) / "run.yaml", json.dumps(data))
            found = evolving_set(file, study, points)
        used = file.generation_rows()["samples_used"][found.generation]
        sets = zip(used.tolist(), found.members, strict=True)
    samples, errors = [], []
    for at, inside in sets:
        samples.append(float(at))
        errors.append(float((inside != members).sum() / members.sum()))
    return samples, errors


def study_of(question: str) -> AnswerStudy:
    return load_answer_study(str(STUDIES / f"{QUESTIONS[question]}.yaml"))


def table(question: str, seeds: int, names: Iterable[str] = ()) -> None:
    """Print one row for each method, as soon as its runs have ended."""
    warnings.filterwarnings("ignore")
    study = study_of(question)
    wants_set = study.answer == "set"
    best = dict.fromkeys(OURS, "") | {name: each.library for name, each in METHODS.items()}
    needs = SETS if wants_set else best
    print(f"\n{question}: expected samples to an error of {study.compared:g}, {seeds} runs")
    for name in names or needs:
        if needs[name] and importlib.util.find_spec(needs[name]) is None:
            print(f"{name:30} skipped: {needs[name]} is not installed", flush=True)
            continue
        began, run = time.process_time(), run_set if wants_set else run_best
        runs = [run(study, name, seed) for seed in range(1, seeds + 1)]
        costs, errors = ([np.array(each) for each in part] for part in zip(*runs, strict=True))
        times = TimesToTargets.of_runs(costs, errors, [study.compared])
        [band] = times.band(np.random.default_rng(BOOTSTRAP_SEED))
        last = np.array([each[-1] for each in errors])
        print(
            f"{name:30} {band_text(band):28} {times.successes[0]:3} of {seeds} reach it; "
            f"last error {np.median(last):.3f} after {times.spent.mean():.0f}; "
            f"{time.process_time() - began:.0f} s of processor time",
            flush=True,
        )


@pytest.mark.benchmark
@pytest.mark.parametrize("question", QUESTIONS)
def test_samples_to_an_answer_beside_public_optimisers(question: str) -> None:
    table(question, SEEDS)


if __name__ == "__main__":
    table(sys.argv[1], int(sys.argv[2]), sys.argv[3:])
