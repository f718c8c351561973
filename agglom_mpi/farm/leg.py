"""One leg of a run: from the start of the program on all ranks to its stop."""

import time
from typing import TYPE_CHECKING, Any

from agglom_mpi.database.writer import CampaignWriter
from agglom_mpi.farm.clock import StopRequest
from agglom_mpi.farm.crew import Crew
from agglom_mpi.farm.launch import warms_first
from agglom_mpi.farm.master import End, Master
from agglom_mpi.farm.order import Order
from agglom_mpi.farm.sharing import PARALLEL, find_nodes
from agglom_mpi.farm.simulator import Simulator
from agglom_mpi.farm.store import leg_fields
from agglom_mpi.report.display import Display

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


def run_leg(
    order: Order,
    database: str,
    writer: CampaignWriter,
    master: Master,
    display: Display,
    stop: StopRequest,
    world: "Intracomm | None",
) -> tuple[End, set[int]]:
    """Simulate on all ranks, and record this start and stop of the program.

    Returns
    -------
    tuple
        How it ended, and ranks that do not answer any more: nothing collective can follow.
    """
    ranks, books = 1 if world is None else world.size, master.books
    with display:
        display.begin(order.work, str(order.path), ranks, master.inversion, database)
        simulator = Simulator(order.work, 0)
        warm_up(simulator, world)
        nodes = find_nodes(world).number
        if database == PARALLEL and world is not None:
            writer.share(world)
        about = leg_fields(ranks, mpi_version(world), nodes=nodes, database=database)
        leg = writer.begin_leg(**about)
        writer.set_status("running")
        crew = Crew(simulator, world)
        if nodes > 1 and writer.shared:
            books.synced = crew.sync
        end = master.run(crew, stop)
    end = master.wind_up(crew, end)
    writer.end_leg(
        leg,
        stopped=time.time(),
        exit_code=end.code,
        samples=books.samples,
        busy_seconds=books.busy_seconds,
        database_seconds=writer.clock.seconds + crew.database_seconds,
    )
    writer.set_status(end.state, end.reason)
    writer.sync()
    return end, crew.missing


def warm_up(simulator: Simulator, world: "Intracomm | None") -> None:
    """Compile on one rank of each node, then let the others load what it compiled."""
    if world is None:
        simulator.warm_up()
        return
    if warms_first(world.rank):
        simulator.warm_up()
    wait(world.Ibarrier())
    if not warms_first(world.rank):
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
