"""One leg of a run: from a start of the program to its stop, on all ranks."""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from agglom_mpi.display.progress import RunProgress
from agglom_mpi.display.run_display import Display
from agglom_mpi.launcher import compiles_for_node
from agglom_mpi.runtime.coordinator import Coordinator, RunEnd
from agglom_mpi.runtime.experiment import Experiment
from agglom_mpi.runtime.launch import GATHERED, PARALLEL, find_nodes
from agglom_mpi.runtime.provenance import leg_start
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.runtime.worker_pool import WorkerPool
from agglom_mpi.storage.writer import CampaignWriter

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


class RunRequest(NamedTuple):
    """The work of a run, and the file that records it."""

    experiment: Experiment
    path: Path
    accept_code_change: bool
    """Whether samples of other sources may be in the file."""
    database: str | None = None
    """Who writes samples, `gathered` or `parallel`; None chooses."""
    accept_new_data: bool = False
    """Whether samples of a file may be compared with other data than it was made with."""
    then: "Callable[[], RunRequest] | None" = None
    """Returns what the same ranks run once this work is finished; may raise the user's mistakes."""


def run_leg(
    request: RunRequest,
    writer: CampaignWriter,
    coordinator: Coordinator,
    display: Display,
    stop: StopRequest,
    world: "Intracomm | None",
) -> tuple[RunEnd, set[int]]:
    """Simulate on all ranks, and record this start and stop of the program in `/legs`.

    The `database` of the request is chosen.

    Returns
    -------
    tuple
        How it ended, and ranks that do not answer any more: nothing collective can follow.
    """
    ranks = 1 if world is None else world.size
    recorder, tally = coordinator.recorder, coordinator.recorder.tally
    experiment, database = request.experiment, request.database or GATHERED
    with display:
        campaign, stage = experiment.campaign, experiment.stage(coordinator.inversion)
        note = "the kernels are made ready"
        progress = RunProgress(stage.done, stage.total, stage.unit, 0.0, 0, note=note)
        what = f"{campaign.title or campaign.name}: {experiment.largest}"
        judged = len(coordinator.inversion.results)
        display.begin(what, str(request.path), ranks, database, judged, progress)
        runner = SampleRunner(experiment, 0)
        warm_up(runner, world, display.message, stop)
        nodes = find_nodes(world)
        if database == PARALLEL and world is not None:
            writer.reopen_parallel(world)
        begun = time.monotonic()
        start = leg_start(ranks, mpi_version(world), nodes=nodes.number, database=database)
        leg = writer.log.begin_leg(**start)
        writer.set_status("running")
        remote = frozenset(range(1, ranks)).difference(nodes.neighbours)
        pool = WorkerPool(runner, world, heart_thread=not writer.parallel, remote=remote)
        if nodes.number > 1 and writer.parallel:
            recorder.synced = pool.sync
        end = coordinator.run(pool, stop)
    end = coordinator.shut_down(pool, end)
    writer.log.end_leg(
        leg,
        stopped=start["started"] + time.monotonic() - begun,  # also if the clock has been set
        exit_code=end.code,
        samples=tally.samples,
        busy_seconds=tally.busy_seconds,
        cpu_seconds=tally.cpu_seconds,
        database_seconds=writer.clock.seconds + pool.database_seconds,
    )
    writer.set_status(end.state, end.reason)
    writer.sync()
    return end, pool.missing


def warm_up(
    runner: SampleRunner,
    world: "Intracomm | None",
    show: Callable[[str], None] = lambda line: None,
    stop: StopRequest | None = None,
) -> None:
    """Compile kernels on one rank of each node, then let the others load them.

    `show` is called with lines on what this rank compiles. A `stop` ends it: the kernels are not
    needed any more then.
    """
    compiles = world is None or compiles_for_node(world.rank)
    if compiles:
        make_ready = partial(runner.warm_up, show)
        make_ready() if stop is None else stop.do_unless_stopped(make_ready)
    if world is None:
        return
    from mpi4py import MPI

    stopped = np.array([stop is not None and bool(stop.reason)], np.uint8)
    wait(world.Iallreduce(MPI.IN_PLACE, stopped, MPI.MAX))
    if not (compiles or stopped[0]):
        runner.warm_up()


def wait(request: Any) -> None:
    """Wait for an MPI request without burning a core."""
    while not request.Test():
        time.sleep(0.002)


def mpi_version(world: "Intracomm | None") -> str:
    """Return name and version of the MPI library; empty for a plain run."""
    if world is None:
        return ""
    from mpi4py import MPI

    return " ".join(MPI.Get_library_version().split()[:3])
