"""A run on all ranks: its request, signals and walltime, the exit code."""

import os
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from agglom_mpi.analysis.summary import summary_table
from agglom_mpi.analysis.warm_start import warm_start_strings
from agglom_mpi.config.campaign import load_campaign
from agglom_mpi.display.display import Display
from agglom_mpi.errors import BAD_INPUT, FAILURE, FINISHED, UserError, error_text
from agglom_mpi.runtime.coordinator import Coordinator, RunEnd
from agglom_mpi.runtime.experiment import Experiment, InversionExperiment
from agglom_mpi.runtime.file_setup import (
    lacking_room,
    output_path,
    prepare,
)
from agglom_mpi.runtime.launch import PARALLEL, Nodes, choose_database, find_nodes
from agglom_mpi.runtime.leg import run_leg, warm_up
from agglom_mpi.runtime.request import Order
from agglom_mpi.runtime.sample_runner import SampleRunner
from agglom_mpi.runtime.stop_request import StopRequest, ignore_signals
from agglom_mpi.runtime.worker import serve_coordinator as serve
from agglom_mpi.storage.access import NotACampaign
from agglom_mpi.storage.files import CampaignLock
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.sample_writer import RankWriter
from agglom_mpi.storage.writer import CampaignWriter

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


class Options(NamedTuple):
    """What `agglom-invert` was asked for."""

    campaign: str
    output: str | None = None
    generations: int | None = None
    max_walltime: float | None = None
    quiet: bool = False
    accept_code_change: bool = False
    database: str | None = None
    allow_code: bool = False


def invert(options: Options, world: "Intracomm | None") -> int:
    """Run a campaign on all ranks; the exit code."""
    display = Display(options.quiet)

    def finish(order: Order) -> None:
        if not options.quiet:
            display.table(summary_table(read_campaign(order.path)))

    return run_on_all_ranks(
        lambda: read_order(options), display, finish, world, max_walltime=options.max_walltime
    )


def read_order(options: Options) -> Order:
    """Campaign and output file that the options name; raises the user's mistakes."""
    campaign = load_campaign(options.campaign, options.allow_code)
    if options.generations is not None:
        campaign = campaign.with_generations(options.generations)
    campaign.check_searchable()
    campaign.check_libraries()
    path = output_path(campaign, options.output)
    work = InversionExperiment(campaign, warm_start_strings(campaign, path))
    return Order(work, path, options.accept_code_change, options.database)


def run_on_all_ranks(
    read: Callable[[], Order],
    display: Display,
    finish: Callable[[Order], None],
    world: "Intracomm | None",
    *,
    max_walltime: float | None = None,
) -> int:
    """Run an order on all ranks; the exit code. Any error but the user's ends the whole job.

    Parameters
    ----------
    read
        Says what to run; called on rank 0 only, may raise the user's mistakes.
    display
        Shows how it goes.
    finish
        Called on rank 0 when all is done.
    world
        The MPI world; None for a plain run.
    max_walltime
        Seconds after which to stop cleanly.
    """
    try:
        if world is not None and world.rank > 0:
            return run_worker(world)
        return run_rank_zero(read, display, finish, StopRequest(max_walltime), world)
    except BaseException:
        if world is None:
            raise
        print(f"rank {world.rank}:\n{traceback.format_exc()}", file=sys.stderr, flush=True)
        end_job(world, FAILURE)
        raise


def run_worker(world: "Intracomm") -> int:
    """Be a worker."""
    ignore_signals()
    code, work, path = world.bcast(None, root=0)
    if work is None:
        return int(code)
    simulator = SampleRunner(work, world.rank)
    warm_up(simulator, world)
    nodes = find_nodes(world)
    file = None if path is None else join(path, world, nodes)
    code = serve(world, simulator, file)
    if file is not None:
        file.close()
    return int(code)


def join(path: Path, world: "Intracomm", nodes: Nodes) -> RankWriter:
    """Open the campaign file together with rank 0."""
    try:
        return RankWriter(path, world, syncs=nodes.syncs)
    except (OSError, NotACampaign):
        time.sleep(30.0)  # rank 0 has failed too, says so and ends the job
        raise


def broadcast_start(
    world: "Intracomm | None", code: int, work: Experiment | None = None, path: Path | None = None
) -> None:
    """Let the workers begin, or go home with an exit code before anything began.

    With a `path` they write their samples there themselves.
    """
    if world is not None:
        world.bcast((code, work, path), root=0)


def run_rank_zero(
    read: Callable[[], Order],
    display: Display,
    finish: Callable[[Order], None],
    stop: StopRequest,
    world: "Intracomm | None",
) -> int:
    """Be rank 0."""
    stop.listen()
    with ExitStack() as stack:
        try:
            order = read()
            work, path = order.work, Path(os.path.realpath(order.path))
            database = choose_database(order.database, world)
            stack.enter_context(CampaignLock(path))
            file = prepare(order.path, work, order.accept_code_change)
            writer = stack.enter_context(CampaignWriter(path))
        except (UserError, OSError) as error:
            code = error.exit_code if isinstance(error, UserError) else BAD_INPUT
            display.error(error_text(error))
            broadcast_start(world, code)
            return code
        try:
            if lacking := lacking_room(order.path, file, work):
                display.message(lacking)
            master = Coordinator(work, file, writer, display)
            if master.replay():
                broadcast_start(world, FINISHED)
                file.refresh()  # deciding again may have written rows that were lost
                if file.status().state != "finished":  # killed just after the last generation
                    writer.set_status("finished", master.finished_because)
                display.message(f"{order.path} is finished already: nothing to do")
                end = None
            else:
                broadcast_start(world, FINISHED, work, path if database == PARALLEL else None)
                end, missing = run_leg(order, database, writer, master, display, stop, world)
                if missing and world is not None:
                    return leave(end, missing, order, display, finish, world)
        except OSError as error:
            kept = "everything written before is whole, run again to go on"
            display.error(f"{error_text(error)}; {kept if path.exists() else 'it is lost'}")
            writer.abandon(error_text(error))
            if world is not None:
                world.Abort(FAILURE)
            return FAILURE
    return conclude(end, order, display, finish)


def conclude(
    end: RunEnd | None, order: Order, display: Display, finish: Callable[[Order], None]
) -> int:
    """Say how it ended, None for long ago; the exit code."""
    if end is not None and end.code != FINISHED:
        show = display.error if end.code == FAILURE else display.message
        show(f"stopped: {end.reason}; everything simulated so far is in {order.path}")
        return end.code
    finish(order)
    return FINISHED


def leave(
    end: RunEnd,
    missing: set[int],
    order: Order,
    display: Display,
    finish: Callable[[Order], None],
    world: "Intracomm",
) -> int:
    """Conclude without ranks that do not answer: the file is complete, the job is ended by force.

    Waiting for them, as any call that all ranks join does, might never end.
    """
    code = conclude(end, order, display, finish)
    ranks = ", ".join(map(str, sorted(missing)))
    display.error(f"no answer from rank {ranks}: the job is ended without; {order.path} is whole")
    sys.stdout.flush()
    end_job(world, code)
    return code


def end_job(world: "Intracomm", code: int) -> None:
    """End all ranks by force, with an exit code."""
    time.sleep(0.2)  # for the launcher, which may drop what it has not passed on
    world.Abort(code)
