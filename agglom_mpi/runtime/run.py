"""A run on all ranks: rank 0 opens the file and lets the others begin; the exit code."""

import os
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from agglom_mpi.analysis.damage import blame_damage
from agglom_mpi.declaration.own_modules import own_error
from agglom_mpi.display.run_display import Display
from agglom_mpi.errors import (
    BAD_INPUT,
    FAILURE,
    FINISHED,
    STOPPED,
    UserError,
    error_text,
    exhausted,
    named_error,
)
from agglom_mpi.formatting import printable
from agglom_mpi.launcher import unread_input
from agglom_mpi.runtime.coordinator import Coordinator, RunEnd
from agglom_mpi.runtime.experiment import Experiment
from agglom_mpi.runtime.file_setup import kept_as_it_was, prepare
from agglom_mpi.runtime.launch import (
    PARALLEL,
    Nodes,
    choose_database,
    find_nodes,
    taken_input,
)
from agglom_mpi.runtime.leg import RunRequest, run_leg, warm_up
from agglom_mpi.runtime.own_code_notes import ended_samples, notes_left, record_as_failed
from agglom_mpi.runtime.programs import (
    MixedJobError,
    Start,
    check_programs,
    own_program,
    receive_start,
)
from agglom_mpi.runtime.stop_request import StopRequest, ignore_signals
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.runtime.watches import LauncherWatch
from agglom_mpi.runtime.worker import serve_coordinator
from agglom_mpi.scheduling.interface import volume_string
from agglom_mpi.storage.access import DamagedCampaign, NotACampaign
from agglom_mpi.storage.fingerprint import AlteredFileError
from agglom_mpi.storage.lock import CampaignLock
from agglom_mpi.storage.row_buffer import RankWriter
from agglom_mpi.storage.writer import CampaignWriter

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


def run_on_all_ranks(
    read: Callable[[], RunRequest],
    display: Display,
    finish: Callable[[RunRequest], None],
    world: "Intracomm | None",
    *,
    max_walltime: float | None = None,
) -> int:
    """Run an experiment on all ranks; any error but the user's ends the whole job.

    Parameters
    ----------
    read
        Returns what to run first; called on rank 0 only, may raise the user's mistakes.
    display
        Shows the progress.
    finish
        Called on rank 0 when a request is done.
    world
        The MPI world; None for a plain run.
    max_walltime
        Time in s after which to stop cleanly.

    Returns
    -------
    int
        The exit code.
    """
    # Of a rank other than 0, for the end of the launcher alone; rank 0 sends the others.
    stop = StopRequest(max_walltime if world is None or world.rank == 0 else None)
    if world is None:
        return run_this_rank(read, display, finish, stop, world)
    launcher = LauncherWatch(lambda: stop.request("the launcher is gone"))
    code = run_this_rank(read, display, finish, stop, world)
    launcher.end(code)
    return code


def run_this_rank(
    read: Callable[[], RunRequest],
    display: Display,
    finish: Callable[[RunRequest], None],
    stop: StopRequest,
    world: "Intracomm | None",
) -> int:
    """Run this rank; return the exit code."""
    try:
        if world is not None and world.rank > 0:
            return run_worker(world, stop)
        code = run_rank_zero(read, display, finish, stop, world)
        if world is not None and (unread := unread_input()):
            display.error(f"warning: {taken_input(unread)}")  # also if quiet: work is left out
        return code
    except UserError as error:  # while kernels are compiled: a law that cannot be
        if world is None:
            display.error(error_text(error))
        else:
            print(error_text(error), file=sys.stderr, flush=True)
            end_job(world, error.exit_code)
        return error.exit_code
    except BaseException as error:
        if world is not None:
            end_job_by(error, world)
        raise


def end_job_by(error: BaseException, world: "Intracomm") -> None:
    """Show the error that is being handled, with this rank, and end all ranks."""
    if isinstance(error, KeyboardInterrupt):
        print("interrupted; run the same command again to continue", file=sys.stderr)
    else:
        text = exhausted(error)
        shown = f" {text}" if text else f"\n{printable(traceback.format_exc())}"
        print(f"rank {world.rank}:{shown}", file=sys.stderr)
    sys.stderr.flush()
    end_job(world, STOPPED if isinstance(error, KeyboardInterrupt) else FAILURE)


def run_worker(world: "Intracomm", stop: StopRequest) -> int:
    """Run a rank other than 0, which reports a `stop`; return the exit code that rank 0 sends."""
    ignore_signals()
    check_programs(world)
    code, more = FINISHED, True
    while more and code == FINISHED:
        try:
            _, code, experiment, path, more = receive_start(world)
        except MixedJobError as error:
            print(error_text(error), file=sys.stderr, flush=True)
            end_job(world, error.exit_code)
            return error.exit_code
        if experiment is None:
            continue
        runner = SampleRunner(experiment, world.rank)
        warm_up(runner, world)
        nodes = find_nodes(world)
        file = None if path is None else open_with_rank_zero(path, world, nodes)
        code = serve_coordinator(world, runner, file, nodes, stop)
        if file is not None:
            file.close()
    return int(code)


def open_with_rank_zero(path: Path, world: "Intracomm", nodes: Nodes) -> RankWriter:
    """Open the campaign file for writing, all ranks together."""
    try:
        return RankWriter(path, world, syncs=nodes.syncs)
    except (OSError, NotACampaign):
        time.sleep(30.0)  # rank 0 has failed too, reports it and ends the job
        raise


def broadcast_start(
    world: "Intracomm | None",
    code: int,
    experiment: Experiment | None = None,
    path: Path | None = None,
    more: bool = False,
) -> None:
    """Let the workers begin with an experiment, or exit with a code if there is none.

    With a `path` they write their samples there themselves. With `more` they wait for another call
    once they have finished.
    """
    if world is not None:
        world.bcast(tuple(Start(own_program(), code, experiment, path, more)), root=0)


def run_rank_zero(
    read: Callable[[], RunRequest],
    display: Display,
    finish: Callable[[RunRequest], None],
    stop: StopRequest,
    world: "Intracomm | None",
) -> int:
    """Run rank 0, one request after the other; return the exit code."""
    stop.listen()
    follows: list[Callable[[], RunRequest] | None] = [read]

    def next_request() -> RunRequest:
        if len(follows) == 1:
            check_programs(world, display.message)
        request = (follows[-1] or read)()
        follows.append(request.then)
        return request

    code = FINISHED
    while code == FINISHED and follows[-1] is not None:
        code = run_request(next_request, display, finish, stop, world)
    return code


def run_request(
    read: Callable[[], RunRequest],
    display: Display,
    finish: Callable[[RunRequest], None],
    stop: StopRequest,
    world: "Intracomm | None",
) -> int:
    """Run one request on rank 0; return the exit code."""
    with ExitStack() as stack:
        try:
            request = read()
            experiment, path = request.experiment, Path(os.path.realpath(request.path))
            database = choose_database(request.database, world)
            notes = notes_left(path)
            lock = stack.enter_context(CampaignLock(path))
            file = prepare(
                request.path, experiment, request.accept_code_change, request.accept_new_data
            )
            lock.lock_file()  # it may be another one by now
            if database == PARALLEL:
                lock.leave_to_mpi()
            writer = stack.enter_context(CampaignWriter(path))
        except (UserError, OSError) as error:
            code = error.exit_code if isinstance(error, UserError) else BAD_INPUT
            display.error(error_text(error))
            if isinstance(error, MixedJobError) and world is not None:
                end_job(world, code)
            broadcast_start(world, code)
            return code
        except Exception as error:
            if not (text := own_error(error)):
                raise
            display.error(printable(text))
            broadcast_start(world, FAILURE)
            return FAILURE
        try:
            for string, sample, text in ended_samples(experiment, file, notes, stop):
                record_as_failed(writer, experiment, string, sample, text)
                number = volume_string(string).text
                display.error(f"string {number} sample {sample} failed: {text}")
                file.refresh()
            for line in kept_as_it_was(request.path, file, experiment):
                display.message(line)
            experiment = experiment.continuing(len(file.generation_rows()))
            experiment.noted_beside = path
            request = request._replace(experiment=experiment, database=database)
            try:
                with blame_damage(path):
                    coordinator = Coordinator(experiment, file, writer, display)
                    complete = coordinator.replay(stop)
            except DamagedCampaign as error:
                display.error(error_text(error))
                broadcast_start(world, error.exit_code)
                return error.exit_code
            if complete:
                end = coordinator.end
                broadcast_start(world, end.code, more=request.then is not None)
                file.refresh()  # deciding again may have written rows that were lost
                # Killed just after the last generation, or the row is damaged.
                if file.status().state != end.state or file.damaged:
                    writer.set_status(end.state, end.reason)
                if end.code == FINISHED:
                    display.message(f"{request.path} is finished already: nothing to do")
            else:
                shared = path if database == PARALLEL else None
                more = request.then is not None
                broadcast_start(world, FINISHED, experiment, shared, more)
                end, missing = run_leg(request, writer, coordinator, display, stop, world)
                if missing and world is not None:
                    if not writer.parallel:  # those that are missing would have to join
                        writer.close()
                    lock.release()  # the launcher may end before this process does
                    return conclude_without(missing, end, request, display, finish, world)
            writer.close()
        except OSError as error:
            rest = "; everything written before is whole, run again to go on"
            says_so = isinstance(error, AlteredFileError | FileNotFoundError)
            display.error(error_text(error) + ("" if says_so else rest))
            writer.abandon(error_text(error))
            lock.release()
            if world is not None:
                world.Abort(FAILURE)
            return FAILURE
        except BaseException as error:  # whoever reads the file must not take it for a running one
            with suppress(Exception):
                writer.set_status(*ended_by(error))
            if not (text := own_error(error)):
                raise
            display.error(f"{printable(text)}; everything simulated so far is in {request.path}")
            if world is not None:
                end_job(world, FAILURE)
            return FAILURE
    code = conclude(end, request, display, finish)
    if code != end.code and request.then is not None:
        broadcast_start(world, code)  # the others wait for what follows
    return code


def ended_by(error: BaseException) -> tuple[str, str]:
    """Return state and reason of a run that ends by an error, or by a second interrupt."""
    if isinstance(error, KeyboardInterrupt):
        return "stopped", "ended by SIGINT before it had stopped"
    return "failed", named_error(error)


def conclude(
    end: RunEnd, request: RunRequest, display: Display, finish: Callable[[RunRequest], None]
) -> int:
    """Show how the run ended; return the exit code."""
    if end.code != FINISHED:
        show = display.error if end.code == FAILURE else display.message
        text = end.reason if end.complete else f"stopped: {end.reason}"
        simulated = "all samples are" if end.complete else "everything simulated so far is"
        show(f"{text}; {simulated} in {request.path}")
        return end.code
    try:
        with blame_damage(request.path):
            finish(request)
    except NotACampaign as error:  # any more
        display.error(error_text(error))
        return FAILURE
    return FINISHED


def conclude_without(
    missing: set[int],
    end: RunEnd,
    request: RunRequest,
    display: Display,
    finish: Callable[[RunRequest], None],
    world: "Intracomm",
) -> int:
    """Conclude without ranks that do not answer: the file is complete, the job is ended by force.

    Waiting for them, as any call that all ranks join does, might never end.
    """
    code = conclude(end, request, display, finish)
    if code == FINISHED and request.then is not None:
        code = STOPPED  # the same command goes on with what follows
    ranks = ", ".join(map(str, sorted(missing)))
    display.error(f"no answer from rank {ranks}: the job is ended without; {request.path} is whole")
    sys.stdout.flush()
    end_job(world, code)
    return code


def end_job(world: "Intracomm", code: int) -> None:
    """End all ranks by force, with an exit code."""
    time.sleep(0.2)  # for the launcher, which may drop what it has not passed on
    world.Abort(code)
