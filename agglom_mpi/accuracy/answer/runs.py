"""The runs of an answer study: campaigns of every setting and seed, their costs, their answers."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.warm_start import warm_start
from agglom_mpi.config.answer_study import AnswerStudy, Setting
from agglom_mpi.display.progress import RunProgress
from agglom_mpi.display.run_display import Display
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.leg import RunRequest
from agglom_mpi.runtime.provenance import sources_digest
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
