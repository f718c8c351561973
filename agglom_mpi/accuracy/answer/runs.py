"""The runs of an answer study: their campaigns and costs, and their answers, which may be sets.

The true set is known at even points of the box by samples of their own, which no run has. A point
is simulated until it is clearly in or out; points at the very edge keep an error, which is stated.
"""

import json
import time
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.study import Rows, completed
from agglom_mpi.analysis.warm_start import warm_start
from agglom_mpi.config.answer_study import AnswerStudy, Setting
from agglom_mpi.display.progress import RunProgress
from agglom_mpi.display.run_display import Display
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.emulated_set import EmulatedSet
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.stored_samples import MIN_STRINGS, stored_samples
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.leg import RunRequest
from agglom_mpi.runtime.provenance import sources_digest
from agglom_mpi.search.stopping import EnsembleState, StoppingRule
from agglom_mpi.storage.files import atomic_file
from agglom_mpi.storage.reader import CampaignData, read_inversion

if TYPE_CHECKING:
    from agglom_mpi.search.proposals import GenerationSummary


FOLDER: Final = "runs"
"""Folder of the campaign files, in that of the report."""


class AnswerRun(NamedTuple):
    """One run of a setting, with a seed, and its campaign file."""

    setting: Setting
    seed: int
    path: Path

    @property
    def name(self) -> str:
        """Setting and seed, as text."""
        return f"{self.setting.name}, seed {self.seed}"

    @property
    def clock_path(self) -> Path:
        """File of the processor times."""
        return self.path.with_suffix(".seconds")

    @property
    def set_path(self) -> Path:
        """File of the sets that the run gives after some of its samples."""
        return self.path.with_suffix(".set.npz")

    def request(self, accept_code_change: bool) -> RunRequest:
        """Return what is to be run."""
        campaign = self.setting.campaign.with_seed(self.seed)
        experiment = InversionExperiment(campaign, warm_start(campaign, self.path))
        return RunRequest(experiment, self.path, accept_code_change)

    def is_finished(self, request: RunRequest) -> bool:
        """Return whether the file holds this very run, to its end."""
        if not self.path.exists():
            return False
        file = read_inversion(self.path, allow_code=True)
        is_same = file.identity == request.experiment.identity()
        is_current = request.accept_code_change or file.last_sources == sources_digest()
        return is_same and is_current and file.status().state == "finished"


def runs_of(study: AnswerStudy, folder: Path) -> list[AnswerRun]:
    """Return all runs of a study, those of one setting after each other."""
    return [
        AnswerRun(setting, seed, folder / FOLDER / f"{setting.stem}_seed{seed}.h5")
        for setting in study.settings
        for seed in range(1, study.seeds + 1)
    ]


class ProcessorClock(Display):
    """A display that shows errors alone, and writes down the processor time of each generation.

    Counted is the time of all threads of this process since the kernels are ready: samples, the
    proposals of the search, the file. A line of the file is one generation, `[leg, generation,
    seconds]`.

    Parameters
    ----------
    path
        File of the times, to which lines are added.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(quiet=True)
        self._path = path
        self._leg = max([leg for leg, _, _ in _lines(path)], default=-1) + 1
        self._begun = time.process_time()

    def begin(
        self, what: str, path: str, ranks: int, database: str, judged: int, progress: RunProgress
    ) -> None:
        """Start the clock."""
        self._begun = time.process_time()

    def generation(
        self, summary: "GenerationSummary", total: int, samples: int, rate: float
    ) -> None:
        """Add a line."""
        line = [self._leg, summary.generation, time.process_time() - self._begun]
        with open(self._path, "a", encoding="ascii") as file:
            file.write(json.dumps(line) + "\n")


def _lines(path: Path) -> Iterator[tuple[int, int, float]]:
    """Yield leg, generation and seconds of the whole lines of a file of processor times."""
    if not path.exists():
        return
    for line in path.read_text(encoding="ascii").splitlines():
        try:
            leg, generation, seconds = json.loads(line)
        except ValueError:  # cut off by a kill
            continue
        yield int(leg), int(generation), float(seconds)


def processor_seconds(path: Path, generations: int) -> NDArray[np.float64]:
    """Return the processor time until the end of each generation, s, shape (generations,).

    A generation whose line a kill has prevented has the time of the next one. What a leg did after
    its last line is not known and not counted.
    """
    found = np.full(generations, np.nan)
    before, last, current = 0.0, 0.0, -1
    for leg, generation, seconds in _lines(path):
        if leg != current:
            before, current = before + last, leg
        last = seconds
        if generation < generations:
            found[generation] = before + seconds
    for generation in range(generations - 2, -1, -1):
        if np.isnan(found[generation]):
            found[generation] = found[generation + 1]
    return np.fmax.accumulate(found) if generations else found


class AnswerHistory(NamedTuple):
    """Cost of a run so far, and its answer, after each of k generations.

    Attributes
    ----------
    samples
        Samples that its decisions rest on, so far, shape (k,).
    seconds
        Processor time so far, s, shape (k,).
    best
        Parameters of the best string so far, shape (k, 10) or wider, SI units.
    claimed
        Its objective by the search, shape (k,).
    """

    samples: NDArray[np.int64]
    seconds: NDArray[np.float64]
    best: NDArray[np.float64]
    claimed: NDArray[np.float64]


def history_of(run: AnswerRun, file: CampaignData) -> AnswerHistory:
    """Return the history of a finished run."""
    rows = file.generation_rows()
    best = [file.parameters[int(string)] for string in rows["best_string"]]
    return AnswerHistory(
        rows["samples_used"].astype(np.int64),
        processor_seconds(run.clock_path, len(rows)),
        np.array(best),
        rows["best_objective"].astype(np.float64),
    )


Floats = NDArray[np.float64]

LADDER: Final = 1.5
"""Factor in the number of samples between two sets of a run."""
MEMBER: Final = 0.5
"""Lowest probability of a string that is taken for a member."""
MIN_SAMPLES: Final = 16
"""Minimum number of samples of a point of the true set."""
CLEAR_ERRORS: Final = 5.0
"""Number of standard errors from the edge at which a point is clearly in or out."""


def box_points(study: AnswerStudy) -> Floats:
    """Return the points at which sets are compared, (n, k), even in the box of the question."""
    return SearchedBox(study.question).allowed_even_strings(study.points)


class EvolvingSet(NamedTuple):
    """Sets that a run gives after some of its generations.

    Attributes
    ----------
    generation
        Numbers of these generations, shape (k,).
    members
        Whether each point is taken for a member, shape (k, n).
    """

    generation: NDArray[np.int64]
    members: NDArray[np.bool_]


def recorded_generations(file: CampaignData) -> NDArray[np.int64]:
    """Return the generations after which sets are made.

    They are at `LADDER` times as many samples each, from `MIN_STRINGS` strings on, and the last.
    """
    rows = file.generation_rows()
    chosen, wanted = [], 0.0
    for row in rows:
        is_last = row["generation"] == rows["generation"][-1]
        if is_last or (row["evaluations"] >= MIN_STRINGS and row["samples_used"] >= wanted):
            chosen.append(int(row["generation"]))
            wanted = LADDER * row["samples_used"]
    return np.array(chosen, np.int64)


def until(file: CampaignData, generation: int) -> CampaignData:
    """Return the data of a campaign file as they were after a generation."""
    strings = file.string_rows()
    strings = strings[strings["generation"] <= generation]
    samples, results = file.all_sample_rows(), file.result_rows()
    known = np.isin(samples["string"], strings["string"])
    tables = {
        "status": file.rows("status"),
        "variables": file.variable_rows(),
        "strings": strings,
        "samples": samples[known & file.are_used(samples)],
        "results": results[np.isin(results["string"], strings["string"])],
        "generations": file.generation_rows()[: generation + 1],
        "legs": file.legs(),
        "failures": file.failures(),
    }
    return CampaignData.of_rows(file.path, file.attributes, tables, allow_code=True)


@single_threaded
def evolving_set(file: CampaignData, study: AnswerStudy, points: Floats) -> EvolvingSet:
    """Return the sets of a finished run at points, (n, k), by an emulator of its samples so far.

    Of fewer than `MIN_STRINGS` strings there is no set: it is empty.
    """
    generations = recorded_generations(file)
    members = np.zeros((len(generations), len(points)), np.bool_)
    for place, generation in enumerate(generations):
        stored = stored_samples(until(file, int(generation)))
        if len(np.unique(stored.strings, axis=0)) < MIN_STRINGS:
            continue
        criterion = study.question.objective.criterion(study.tolerance)
        emulated = EmulatedSet(SearchedBox(study.question), criterion, stored, {})
        members[place] = emulated.probability(points) >= MEMBER
    return EvolvingSet(generations, members)


def sets_of(run: AnswerRun, study: AnswerStudy, points: Floats, file: CampaignData) -> EvolvingSet:
    """Return the sets of a finished run at points, (n, k), from the file beside it, which it keeps.

    Where there is none, or one of something else, the sets are computed.
    """
    origin = f"{file.attributes['campaign_sha256']} {study.tolerance!r} {study.points}"
    with suppress(OSError, ValueError, KeyError, zipfile.BadZipFile), np.load(run.set_path) as kept:
        if str(kept["origin"]) == origin:
            return EvolvingSet(kept["generation"], kept["members"])
    found = evolving_set(file, study, points)
    with atomic_file(run.set_path, replace=True) as path, open(path, "wb") as target:
        np.savez_compressed(target, origin=origin, **found._asdict())
    return found


class ClearMembership(StoppingRule):
    """The objective is clearly below or above a tolerance.

    Attributes
    ----------
    tolerance
        Largest objective of a member.
    max_samples
        Maximum number of samples.
    """

    tolerance: float
    max_samples: int
    min_samples: int = MIN_SAMPLES

    def holds(self, before: EnsembleState[Any], after: EnsembleState[Any]) -> Any:
        """Return whether the edge is `CLEAR_ERRORS` standard errors away."""
        away = abs(after.objective - self.tolerance)
        return (after.samples >= self.min_samples) & (away > CLEAR_ERRORS * after.standard_error)


class TrueSet(NamedTuple):
    """The set by samples of its own.

    Attributes
    ----------
    members
        Which points are members, shape (n,).
    blur
        Expected number of points that are wrongly in or out, by the errors of their means.
    """

    members: NDArray[np.bool_]
    blur: float

    @property
    def resolution(self) -> float:
        """Relative error that an exact answer would be given for the errors of the true set."""
        return self.blur / max(int(self.members.sum()), 1)

    def errors(self, found: NDArray[np.bool_]) -> Floats:
        """Return the relative errors of sets, (k, n): points wrongly in or out per member, (k,)."""
        wrong = (found != self.members).sum(axis=1)
        return np.asarray(wrong / max(int(self.members.sum()), 1))


def true_set(study: AnswerStudy, samples: list[Rows]) -> TrueSet:
    """Return the true set by the samples of each point, in the order of the points."""
    from scipy.special import ndtr

    estimates = [study.question.objective.of_rows(completed(rows)) for rows in samples]
    value, error = np.array(estimates).T
    away = np.abs(value - study.tolerance)
    with np.errstate(divide="ignore", invalid="ignore"):
        wrong = np.where(error > 0.0, ndtr(-away / error), 0.0)
    return TrueSet(value <= study.tolerance, float(np.nansum(wrong)))
