"""`agglom accuracy --answer`: the error of what a user publishes against what it costs."""

import shlex
import time
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

from agglom_mpi.accuracy.answer_errors import answers_of, estimation
from agglom_mpi.accuracy.answer_report import AnswerReport, write_answer_report
from agglom_mpi.accuracy.answer_runs import FOLDER, AnswerRun, ProcessorClock, runs_of
from agglom_mpi.accuracy.answer_sets import box_points, keep_set
from agglom_mpi.accuracy.command import AccuracyOptions, command_words, require_report
from agglom_mpi.accuracy.run_times import busy_lines
from agglom_mpi.accuracy.study import StudyDisplay
from agglom_mpi.analysis.damage import blame_damage
from agglom_mpi.analysis.tables import wall_over_cpu
from agglom_mpi.config.answer_study import AnswerStudy, load_answer_study
from agglom_mpi.display.run_display import Display
from agglom_mpi.errors import BAD_INPUT, FINISHED, STOPPED, UserError, error_text
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import check_writable
from agglom_mpi.runtime.leg import RunRequest
from agglom_mpi.runtime.run import run_on_all_ranks
from agglom_mpi.runtime.separate_runs import run_alone, run_separately, shared
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.storage.reader import read_campaign

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm

ESTIMATES: Final = "estimates.h5"
"""File of the fresh samples, in the folder of the report."""
REHEARSED: Final = 3
"""Number of generations of a rehearsal: the third one is the first that a regression proposes."""


def answer_accuracy(options: AccuracyOptions, world: "Intracomm | None") -> int:
    """Run all campaigns of a study, estimate their answers, and report; return the exit code."""
    began, display = time.monotonic(), StudyDisplay(options.quiet)
    code, study = shared(partial(_prepare, options), display, world)
    if study is None:
        return code
    folder = Path(options.out)
    runs = runs_of(study, folder)
    code = run_separately(
        [run.request(options.accept_code_change) for run in runs],
        _Runner(study, runs, display, world),
        world,
        options.max_walltime,
    )
    if code != FINISHED:
        if code == STOPPED and (world is None or world.rank == 0):
            display.message("stopped; run the same command again to continue")
        return code

    def read() -> RunRequest:
        experiment = estimation(study, folder)
        path = folder / ESTIMATES
        return RunRequest(experiment, path, options.accept_code_change, options.database)

    def finish(request: RunRequest) -> None:
        path = write_report(study, options, request.path)
        display.message(f"{path} with its figures and tables")

    left = options.max_walltime
    if left is not None:
        left = max(1e-3, left - (time.monotonic() - began))
    return run_on_all_ranks(read, display, finish, world, max_walltime=left)


def _prepare(options: AccuracyOptions) -> AnswerStudy:
    """Read the study, and make the folders."""
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
        self,
        study: AnswerStudy,
        runs: list[AnswerRun],
        display: Display,
        world: "Intracomm | None",
    ) -> None:
        self._study = study
        self._runs = {run.path: run for run in runs}
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
        run = self._runs[request.path]
        code = FINISHED
        if not run.is_finished(request):
            self._rehearse(run, stop)
            code = run_alone(request, ProcessorClock(run.clock_path), lambda request: None, stop)
        if code == FINISHED and self._points is not None:
            keep_set(run, self._study, self._points)
        self._done += 1
        if code == FINISHED and self._shows:
            share = f"of {-(-len(self._runs) // self._ranks)}"
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
        experiment = InversionExperiment(campaign.with_generations(count))
        with TemporaryDirectory() as folder:
            request = RunRequest(experiment, Path(folder) / run.path.name, False)
            run_alone(request, Display(quiet=True), lambda request: None, stop)


def write_report(study: AnswerStudy, options: AccuracyOptions, path: Path) -> Path:
    """Write the report of finished runs and their estimates, which are in a file."""
    file = read_campaign(path, options.allow_code)
    words = [*command_words(options), "--answer"]
    answers = answers_of(study, Path(options.out), file)
    rows = file.all_sample_rows()
    busy = tuple(busy_lines(wall_over_cpu(rows), []))
    report = AnswerReport(study, answers, shlex.join(words), len(rows), busy)
    return write_answer_report(Path(options.out), report)
