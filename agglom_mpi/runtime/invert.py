"""The command `agglom-invert`, and the same from Python: in this process, or by its own ranks."""

import os
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from agglom_mpi.analysis.run_warnings import run_warnings
from agglom_mpi.analysis.summary import summary_table
from agglom_mpi.analysis.warm_start import warm_start
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.searchable import check_search_library, check_searchable
from agglom_mpi.config.yaml_source import CampaignError, parse, warn
from agglom_mpi.contracts.promises import promises_of
from agglom_mpi.display.run_display import Display
from agglom_mpi.errors import FINISHED, STOPPED, UserError
from agglom_mpi.launcher import find_launcher, python_command, without_rank_variables
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import as_recorded, output_path
from agglom_mpi.runtime.leg import RunRequest
from agglom_mpi.runtime.own_code_notes import notes_left
from agglom_mpi.runtime.provenance import sources_digest
from agglom_mpi.runtime.run import run_on_all_ranks, run_this_rank
from agglom_mpi.runtime.stop_request import StopRequest, handlers_kept
from agglom_mpi.scheduling.interface import volume_string
from agglom_mpi.storage.reader import read_campaign, read_inversion
from agglom_mpi.storage.schema import CERTIFICATE

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


class InvertOptions(NamedTuple):
    """Options of `agglom-invert`, as `cli/invert.py` declares them."""

    campaign: str
    output: str | None = None
    generations: int | None = None
    max_walltime: float | None = None
    quiet: bool = False
    accept_code_change: bool = False
    accept_new_data: bool = False
    database: str | None = None
    allow_code: bool = False
    strict: bool = False
    seed: int | None = None


def invert(options: InvertOptions, world: "Intracomm | None") -> int:
    """Run a campaign on all ranks; return the exit code."""
    display = Display(options.quiet)

    def finish(request: RunRequest) -> None:
        if options.quiet:
            return
        if request.experiment.purpose == CERTIFICATE:
            from agglom_mpi.runtime.certify import verdict_text

            display.table(verdict_text(request, options.allow_code))
            return
        final = request.experiment.campaign.final
        file = read_campaign(request.path, options.allow_code)
        display.table(summary_table(file, final.strings if final else None))
        for line in run_warnings(file):
            display.message(f"warning: {line}")

    return run_on_all_ranks(
        lambda: read_request(options, display.message),
        display,
        finish,
        world,
        max_walltime=options.max_walltime,
    )


def read_request(
    options: InvertOptions, show: Callable[[str], None] = lambda line: None
) -> RunRequest:
    """Load the campaign that the options name; `show` warnings, raise the user's mistakes."""
    return request_for(load_campaign(options.campaign, options.allow_code), options, show)


def request_for(
    campaign: Campaign, options: InvertOptions, show: Callable[[str], None] = lambda line: None
) -> RunRequest:
    """Return what to run of a campaign; arguments and errors as of `read_request`.

    Components of one's own are tested before the first leg, which makes the file; later legs and
    other ranks do not test them.
    """
    if options.seed is not None:
        campaign = campaign.with_seed(options.seed)
    if options.generations is not None:
        campaign = campaign.with_generations(options.generations)
    path = output_path(campaign, options.output, options.seed)
    campaign = as_recorded(campaign, path)
    narrow = check_searchable(campaign)
    check_search_library(campaign)
    warn([*campaign.warnings(), *narrow], options.strict, show)
    if options.allow_code and not path.exists():  # a file records that they have passed
        for line in promises_of(campaign, options.allow_code):
            show(line)
    start = warm_start(campaign, path)
    warn(start.warnings, options.strict, show)
    learned = "" if start.learned is None else start.learned.sources
    if learned and learned != sources_digest() and not options.accept_code_change:
        message = (
            f"{campaign.search.learns_from}: was computed by other simulation sources; samples "
            "would not be comparable. --accept-code-change learns from them all the same"
        )
        source = parse(campaign.text, campaign.name)
        raise CampaignError(source.problem(("search", "learn_from"), message))
    experiment = InversionExperiment(campaign, start)
    accepted = options.accept_code_change, options.database, options.accept_new_data
    request = RunRequest(experiment, path, *accepted)
    if (claim := campaign.required_plan.certify) is None:
        return request

    def certificate() -> RunRequest:
        from agglom_mpi.runtime.certify import certification

        data = read_inversion(path, options.allow_code)
        found = certification(data, claim, show, campaign.user_function)
        return request._replace(experiment=found, path=found.path, accept_new_data=False)

    return request._replace(then=certificate)


LAST_LINES: Final = 20
"""Number of last lines of ranks that failed which the error has."""
ENDS_WITH_PARENT: Final = """
import ctypes, os, signal, sys
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, signal.SIGINT)  # PR_SET_PDEATHSIG
    if os.getppid() != int(sys.argv[1]):
        sys.exit(1)
os.execv(sys.argv[2], sys.argv[2:])
"""
"""Program that becomes the one of its arguments, which is asked to stop when its parent ends."""
COMMAND: Final = "from agglom_mpi.cli import invert; invert()"


class RunFailedError(UserError, RuntimeError):
    """A run ended by an error; its text is what the run said."""


def run_here(campaign: Campaign, options: InvertOptions) -> Path:
    """Run a campaign in this process; return the path of its file.

    Raises
    ------
    RunFailedError
        If the run ends by an error.
    """
    display = Told(options.quiet)
    request = request_for(campaign, options, display.message)
    stop = StopRequest(options.max_walltime)
    with handlers_kept():
        code = run_this_rank(lambda: request, display, lambda request: None, stop, None)
    check_end(code, display.errors)
    return request.path


def run_by_ranks(campaign: Campaign, options: InvertOptions, ranks: int) -> Path:
    """Run a campaign by ranks that `mpirun` starts; return the path of its file.

    Raises
    ------
    RunFailedError
        If the run ends by an error.
    """
    path, launcher = (
        output_path(campaign, options.output),
        find_launcher(os.environ, own_first=True),
    )
    if launcher is None:
        raise RunFailedError("ranks need mpirun: pip install 'agglom_mpi[mpi]'")
    command = [*python_command(COMMAND), campaign.name, "--output", path]
    words = [launcher, "-n", ranks, *command]
    words += ["--quiet"] * options.quiet + ["--allow-code"] * options.allow_code
    if options.max_walltime is not None:
        words += ["--max-walltime", f"{options.max_walltime:g}s"]
    code, said = follow([*map(str, words)])
    if code not in (FINISHED, STOPPED) and (noted := notes_left(path)):
        begun = ", ".join(f"string {volume_string(i).text} sample {k}" for i, k in noted)
        said.append(f"begun last, where code of your own runs: {begun}; run again to find which")
    check_end(code, said)
    return path


class Told(Display):
    """A display that keeps errors, which are raised instead of shown.

    Attributes
    ----------
    errors
        Their texts.
    """

    def __init__(self, quiet: bool) -> None:
        super().__init__(quiet)
        self.errors: list[str] = []

    def error(self, text: str) -> None:
        """Keep an error."""
        self.errors.append(text)


def follow(words: list[str]) -> tuple[int, list[str]]:
    """Run a command, passing its standard error on; its exit code and the last lines of that.

    An interrupt is passed on as a request to stop, and so is the end of this process.
    """
    last: deque[str] = deque(maxlen=LAST_LINES)
    process = subprocess.Popen(
        [*python_command(ENDS_WITH_PARENT), str(os.getpid()), *words],
        env=without_rank_variables(os.environ),  # this process may be a rank itself
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stderr is not None
    with process:
        while True:
            try:
                for line in process.stderr:
                    last.append(line.rstrip())
                    print(line, end="", file=sys.stderr, flush=True)
                return process.wait(), list(last)
            except KeyboardInterrupt:
                process.send_signal(signal.SIGINT)


def check_end(code: int, said: list[str]) -> None:
    """Raise a RunFailedError if a run has neither finished nor stopped."""
    if code not in (FINISHED, STOPPED):
        raise RunFailedError("\n".join(said) or f"the run ended with code {code}")
