"""How far a run is, as rank 0 knows it."""

import time

from agglom_mpi.display.progress import Progress
from agglom_mpi.display.remaining_time import remaining_by_work, remaining_in_turns
from agglom_mpi.runtime.experiment import Experiment
from agglom_mpi.runtime.post_stages import PostStage
from agglom_mpi.runtime.recorder import RunRecorder
from agglom_mpi.search.inversion import Inversion


def of_search(
    work: Experiment, inversion: Inversion, recorder: RunRecorder, ranks: int, in_flight: int
) -> Progress:
    """Tell how far the search is; `in_flight` samples are with the ranks."""
    stage = work.stage(inversion)
    remaining = (
        remaining_in_turns(recorder.laps, stage.total - stage.done, recorder.lap)
        if stage.in_turns
        else None
    )
    return _everywhere(recorder, ranks, in_flight)._replace(
        done=stage.done,
        total=stage.total,
        unit=stage.unit,
        strings_open=len(inversion.live),
        remaining=remaining,
        may_end_sooner=stage.may_end_sooner,
    )


def of_post_stage(
    post_stage: PostStage, begun: float, recorder: RunRecorder, ranks: int
) -> Progress:
    """Tell how far a stage is that began at a time of the monotonic clock."""
    stage = post_stage.stage
    rest, done = stage.total - stage.done, stage.done - post_stage.done_before
    return _everywhere(recorder, ranks, post_stage.scheduler.in_flight)._replace(
        done=stage.done,
        total=stage.total,
        unit=stage.unit,
        remaining=remaining_by_work(recorder.fresh_costs, done, rest, time.monotonic() - begun),
    )


def _everywhere(recorder: RunRecorder, ranks: int, in_flight: int) -> Progress:
    """Tell what is the same in every phase."""
    elapsed = recorder.elapsed
    return Progress(
        done=0,
        total=0,
        unit="",
        elapsed=elapsed,
        samples=recorder.all_samples,
        rate=recorder.rate if recorder.samples else None,
        busy=recorder.busy_seconds / (elapsed * ranks) if recorder.samples else None,
        in_flight=in_flight,
        failed=recorder.failed,
        best=recorder.best,
    )
