"""One leg of a run: from the start of the program on all ranks to its stop."""

import time
from typing import TYPE_CHECKING, Any

from agglom_mpi.display.display import Display
from agglom_mpi.display.progress import Progress
from agglom_mpi.launcher import compiles_for_node
from agglom_mpi.runtime.coordinator import Coordinator, RunEnd
from agglom_mpi.runtime.file_setup import leg_fields
from agglom_mpi.runtime.launch import PARALLEL, find_nodes
from agglom_mpi.runtime.request import Order
from agglom_mpi.runtime.sample_runner import SampleRunner
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.runtime.worker_pool import WorkerPool
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.storage.writer import CampaignWriter

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


def run_leg(
    order: Order,
    database: str,
    writer: CampaignWriter,
    master: Coordinator,
    display: Display,
    stop: StopRequest,
    world: "Intracomm | None",
) -> tuple[RunEnd, set[int]]:
    """Simulate on all ranks, and record this start and stop of the program.

    Returns
    -------
    tuple
        How it ended, and ranks that do not answer any more: nothing collective can follow.
    """
    ranks, recorder = 1 if world is None else world.size, master.recorder
    with display:
        _announce(display, order, ranks, database, master.inversion)
        simulator = SampleRunner(order.work, 0)
        warm_up(simulator, world)
        nodes = find_nodes(world).number
        if database == PARALLEL and world is not None:
            writer.reopen_parallel(world)
        about = leg_fields(ranks, mpi_version(world), nodes=nodes, database=database)
        leg = writer.begin_leg(**about)
        writer.set_status("running")
        pool = WorkerPool(simulator, world)
        if nodes > 1 and writer.parallel:
            recorder.synced = pool.sync
        end = master.run(pool, stop)
    end = master.wind_up(pool, end)
    writer.end_leg(
        leg,
        stopped=time.time(),
        exit_code=end.code,
        samples=recorder.samples,
        busy_seconds=recorder.busy_seconds,
        database_seconds=writer.clock.seconds + pool.database_seconds,
    )
    writer.set_status(end.state, end.reason)
    writer.sync()
    return end, pool.missing


def warm_up(simulator: SampleRunner, world: "Intracomm | None") -> None:
    """Compile on one rank of each node, then let the others load what it compiled."""
    if world is None:
        simulator.warm_up()
        return
    if compiles_for_node(world.rank):
        simulator.warm_up()
    wait(world.Ibarrier())
    if not compiles_for_node(world.rank):
        simulator.warm_up()


def wait(request: Any) -> None:
    """Wait for an MPI request without burning a core."""
    while not request.Test():
        time.sleep(0.002)


def mpi_version(world: "Intracomm | None") -> str:
    """Name and version of the MPI library; empty for a plain run."""
    if world is None:
        return ""
    from mpi4py import MPI

    return " ".join(MPI.Get_library_version().split()[:3])


def _announce(
    display: Display, order: Order, ranks: int, database: str, inversion: Inversion
) -> None:
    work, stage = order.work, order.work.stage(inversion)
    what = f"{work.campaign.title or work.campaign.name}: {work.largest}"
    note = "the kernels are made ready"
    progress = Progress(stage.done, stage.total, stage.unit, 0.0, 0, note=note)
    display.begin(what, str(order.path), ranks, database, len(inversion.results), progress)
