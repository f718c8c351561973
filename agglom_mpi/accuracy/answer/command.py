"""`agglom accuracy --answer`: the error of what a user publishes against what it costs."""

import time
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

from agglom_mpi.accuracy.answer.answer_report import write_answer_report
from agglom_mpi.accuracy.answer.errors import answers_of, estimation
from agglom_mpi.accuracy.answer.runs import (
    FOLDER,
    AnswerRun,
    ProcessorClock,
    box_points,
    runs_of,
    sets_of,
)
from agglom_mpi.accuracy.report import require_report
from agglom_mpi.accuracy.study import Stages, StudyOptions, run_stages
from agglom_mpi.analysis.damage import blame_damage
from agglom_mpi.analysis.warm_start import warm_start
from agglom_mpi.config.answer_study import AnswerStudy, load_answer_study
from agglom_mpi.display.run_display import Display, StudyDisplay
from agglom_mpi.errors import BAD_INPUT, FINISHED, STOPPED, UserError, error_text
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import check_writable
from agglom_mpi.runtime.leg import RunRequest
from agglom_mpi.runtime.run import run_this_rank
from agglom_mpi.runtime.separate_runs import run_separately, shared
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.storage.reader import read_inversion

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm

ESTIMATES: Final = "estimates.h5"
"""File of the fresh samples, in the folder of the report."""
REHEARSED: Final = 3
"""Number of generations of a rehearsal: the third one is the first that a regression proposes."""


def answer_accuracy(options: StudyOptions, world: "Intracomm | None") -> int:
    """Run all campaigns of a study, estimate their answers, and report; return the exit code."""
    began, display = time.monotonic(), StudyDisplay(options.quiet)
    code, study = shared(partial(_prepare, options), display, world)
    if study is None:
        return code
    runner = _Runner(study, Path(options.out), display, world)
    requests = [run.request(options.accept_code_change) for run in runner.runs.values()]
    code = run_separately(requests, runner, world, options.max_walltime)
    if code == STOPPED and (world is None or world.rank == 0):
        display.message("stopped; run the same command again to continue")
    if code != FINISHED:
        return code
    if options.max_walltime is not None:
        left = max(1e-3, options.max_walltime - (time.monotonic() - began))
        options = options._replace(max_walltime=left)
    return run_stages(options, world, lambda: estimated(study, options))


def estimated(study: AnswerStudy, options: StudyOptions) -> Stages:
    """Yield the fresh samples of the answers of finished runs, and write the report."""
    folder = Path(options.out)
    file = yield ESTIMATES, estimation(study, folder)
    return write_answer_report(folder, study, answers_of(study, folder, file), options, file)


def _prepare(options: StudyOptions) -> AnswerStudy:
    require_report()
    study = load_answer_study(options.sources[0], options.allow_code)
    runs = Path(options.out) / FOLDER
    runs.mkdir(parents=True, exist_ok=True)
    check_writable(runs.parent / ESTIMATES)
    check_writable(runs / "any.h5")
    return study


class _Runner:
    """Runs one campaign on this rank, unless it is finished, and makes its sets.

    The first one of a setting is rehearsed, so that the processor time is that of the run: what a
    process compiles, loads and imports is no part of it.
    """

    def __init__(
        self, study: AnswerStudy, folder: Path, display: Display, world: "Intracomm | None"
    ) -> None:
        self.runs = {run.path: run for run in runs_of(study, folder)}
        self._study = study
        self._shows = world is None or world.rank == 0
        self._ranks = 1 if world is None else world.size
        self._display = display
        self._done = 0
        self._rehearsed: set[str] = set()
        self._points = box_points(study) if study.answer == "set" else None

    def __call__(self, request: RunRequest, stop: StopRequest) -> int:
        try:
            with blame_damage(request.path):
                return self._run(request, stop)
        except (UserError, OSError) as error:
            self._display.error(error_text(error))
            return error.exit_code if isinstance(error, UserError) else BAD_INPUT

    def _run(self, request: RunRequest, stop: StopRequest) -> int:
        run = self.runs[request.path]
        code = FINISHED
        if not run.is_finished(request):
            self._rehearse(run, stop)
            clock = ProcessorClock(run.clock_path)
            code = run_this_rank(lambda: request, clock, lambda request: None, stop, None)
        if code == FINISHED and self._points is not None:
            sets_of(run, self._study, self._points, read_inversion(run.path, allow_code=True))
        self._done += 1
        if code == FINISHED and self._shows:
            share = f"of {-(-len(self.runs) // self._ranks)}"
            share += " of rank 0" if self._ranks > 1 else ""
            self._display.message(f"run {self._done} {share}: {run.name}")
        return code

    def _rehearse(self, run: AnswerRun, stop: StopRequest) -> None:
        """Run the first generations of a setting, and forget them."""
        if run.setting.stem in self._rehearsed:
            return
        self._rehearsed.add(run.setting.stem)
        campaign = run.setting.campaign
        count = min(REHEARSED, campaign.stopping.generations)
        experiment = InversionExperiment(campaign.with_generations(count), warm_start(campaign))
        with TemporaryDirectory() as folder:
            request = RunRequest(experiment, Path(folder) / run.path.name, False)
            run_this_rank(lambda: request, Display(True), lambda request: None, stop, None)
