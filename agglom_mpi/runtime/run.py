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
from agglom_mpi.formatting import pluralise, printable
from agglom_mpi.launcher import unread_input
from agglom_mpi.runtime.coordinator import Coordinator, RunEnd
from agglom_mpi.runtime.experiment import Experiment
from agglom_mpi.runtime.file_setup import kept_as_it_was, prepare
from agglom_mpi.runtime.launch import (
    PARALLEL,
    MixedJobError,
    Nodes,
    Start,
    check_programs,
    choose_database,
    find_nodes,
    own_program,
    receive_start,
)
from agglom_mpi.runtime.leg import RunRequest, run_leg, warm_up
from agglom_mpi.runtime.own_code_notes import notes_left, record_ended
from agglom_mpi.runtime.stop_request import StopRequest, ignore_signals
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.runtime.watches import LauncherWatch
from agglom_mpi.runtime.worker import serve_coordinator
from agglom_mpi.storage.access import DamagedCampaign, NotACampaign
from agglom_mpi.storage.files import AlteredFileError
from agglom_mpi.storage.lock import CampaignLock
from agglom_mpi.storage.reader import CampaignData
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
        code = RankZero(display, finish, stop, world).run(read)
        if world is not None and (unread := unread_input()):
            display.error(  # also if quiet: work is left out
                f"warning: the launcher has read {pluralise(unread, 'byte')} of standard input, "
                "which no rank uses; a loop `while read` around it ends with this campaign: add "
                "</dev/null to the launcher's command"
            )
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


def end_job(world: "Intracomm", code: int) -> None:
    """End all ranks by force, with an exit code."""
    time.sleep(0.2)  # for the launcher, which may drop what it has not passed on
    world.Abort(code)


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


class RankZero:
    """Rank 0: it opens the file of each request, decides, and lets the other ranks join.

    Parameters
    ----------
    display, finish
        As for `run_on_all_ranks`.
    stop
        Whether to stop early.
    world
        The MPI world; None for a plain run.
    """

    def __init__(
        self,
        display: Display,
        finish: Callable[[RunRequest], None],
        stop: StopRequest,
        world: "Intracomm | None",
    ) -> None:
        self._display, self._finish, self._stop, self._world = display, finish, stop, world

    def run(self, read: Callable[[], RunRequest]) -> int:
        """Run what `read` returns and what follows it, one after the other; return the exit code.

        Every `read` may raise the user's mistakes.
        """
        self._stop.listen()
        follows: list[Callable[[], RunRequest] | None] = [read]

        def next_request() -> RunRequest:
            if len(follows) == 1:
                check_programs(self._world, self._display.message)
            request = (follows[-1] or read)()
            follows.append(request.then)
            return request

        code = FINISHED
        while code == FINISHED and follows[-1] is not None:
            code = self._run_next(next_request)
        return code

    def _run_next(self, read: Callable[[], RunRequest]) -> int:
        """Run one request; return the exit code."""
        with ExitStack() as stack:
            try:
                request = read()
                path = Path(os.path.realpath(request.path))
                request = request._replace(database=choose_database(request.database, self._world))
                notes = notes_left(path)
                lock = stack.enter_context(CampaignLock(path))
                accepted = request.accept_code_change, request.accept_new_data
                file = prepare(request.path, request.experiment, *accepted)
                lock.lock_file()  # it may be another one by now
                if request.database == PARALLEL:
                    lock.leave_to_mpi()
                writer = stack.enter_context(CampaignWriter(path))
            except (UserError, OSError) as error:
                return self._refuse(error)
            except Exception as error:
                if not (text := own_error(error)):
                    raise
                self._display.error(printable(text))
                self._broadcast(FAILURE)
                return FAILURE
            try:
                for line in record_ended(request.experiment, file, writer, notes, self._stop):
                    self._display.error(line)
                for line in kept_as_it_was(request.path, file, request.experiment):
                    self._display.message(line)
                experiment = request.experiment.continuing(len(file.generation_rows()))
                experiment.noted_beside = path
                request = request._replace(experiment=experiment)
                try:
                    with blame_damage(path):
                        coordinator = Coordinator(experiment, file, writer, self._display)
                        complete = coordinator.replay(self._stop)
                except DamagedCampaign as error:
                    return self._refuse(error)
                missing, more = set[int](), request.then is not None
                if complete:
                    end = coordinator.end
                    self._broadcast(end.code, more=more)
                    self._leave_as_it_is(request, file, writer, end)
                else:
                    shared = path if request.database == PARALLEL else None
                    self._broadcast(FINISHED, experiment, shared, more)
                    run = writer, coordinator, self._display, self._stop, self._world
                    end, missing = run_leg(request, *run)
                if missing and self._world is not None:
                    if not writer.parallel:  # those that are missing would have to join
                        writer.close()
                    lock.release()  # the launcher may end before this process does
                    return self._conclude_without(missing, end, request, self._world)
                writer.close()
            except OSError as error:
                rest = "; everything written before is whole, run again to go on"
                says_so = isinstance(error, AlteredFileError | FileNotFoundError)
                self._display.error(error_text(error) + ("" if says_so else rest))
                writer.abandon(error_text(error))
                lock.release()
                if self._world is not None:
                    self._world.Abort(FAILURE)
                return FAILURE
            except BaseException as error:  # a reader must not take the file for a running one
                with suppress(Exception):
                    writer.set_status(*ended_by(error))
                if not (text := own_error(error)):
                    raise
                kept = f"everything simulated so far is in {request.path}"
                self._display.error(f"{printable(text)}; {kept}")
                if self._world is not None:
                    end_job(self._world, FAILURE)
                return FAILURE
        code = self._conclude(end, request)
        if code != end.code and request.then is not None:
            self._broadcast(code)  # the others wait for what follows
        return code

    def _refuse(self, error: UserError | OSError) -> int:
        """Show why a request cannot be run, and let the others exit; return the exit code."""
        code = error.exit_code if isinstance(error, UserError) else BAD_INPUT
        self._display.error(error_text(error))
        if isinstance(error, MixedJobError) and self._world is not None:
            end_job(self._world, code)
        self._broadcast(code)
        return code

    def _leave_as_it_is(
        self, request: RunRequest, file: CampaignData, writer: CampaignWriter, end: RunEnd
    ) -> None:
        """Say that nothing is left to do, also in the file."""
        file.refresh()  # deciding again may have written rows that were lost
        # Killed just after the last generation, or the row is damaged.
        if file.status().state != end.state or file.damaged:
            writer.set_status(end.state, end.reason)
        if end.code == FINISHED:
            self._display.message(f"{request.path} is finished already: nothing to do")

    def _broadcast(
        self,
        code: int,
        experiment: Experiment | None = None,
        path: Path | None = None,
        more: bool = False,
    ) -> None:
        """Let the others begin with an experiment, or exit with a code if there is none.

        With a `path` they write their samples there themselves. With `more` they wait for another
        call once they have finished.
        """
        if self._world is not None:
            start = Start(own_program(), code, experiment, path, more)
            self._world.bcast(tuple(start), root=0)

    def _conclude(self, end: RunEnd, request: RunRequest) -> int:
        """Show how the run ended; return the exit code."""
        if end.code != FINISHED:
            show = self._display.error if end.code == FAILURE else self._display.message
            text = end.reason if end.complete else f"stopped: {end.reason}"
            simulated = "all samples are" if end.complete else "everything simulated so far is"
            show(f"{text}; {simulated} in {request.path}")
            return end.code
        try:
            with blame_damage(request.path):
                self._finish(request)
        except NotACampaign as error:  # any more
            self._display.error(error_text(error))
            return FAILURE
        return FINISHED

    def _conclude_without(
        self, missing: set[int], end: RunEnd, request: RunRequest, world: "Intracomm"
    ) -> int:
        """Conclude without ranks that do not answer: the file is whole, the job ends by force.

        Waiting for them, as any call that all ranks join does, might never end.
        """
        code = self._conclude(end, request)
        if code == FINISHED and request.then is not None:
            code = STOPPED  # the same command goes on with what follows
        ranks, whole = ", ".join(map(str, sorted(missing))), f"{request.path} is whole"
        self._display.error(f"no answer from rank {ranks}: the job is ended without; {whole}")
        sys.stdout.flush()
        end_job(world, code)
        return code


def ended_by(error: BaseException) -> tuple[str, str]:
    """Return state and reason of a run that ends by an error, or by a second interrupt."""
    if isinstance(error, KeyboardInterrupt):
        return "stopped", "ended by SIGINT before it had stopped"
    return "failed", named_error(error)
