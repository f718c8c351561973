"""The command `agglom-invert`: what it runs, and what it shows at the end."""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from agglom_mpi.analysis.run_warnings import run_warnings
from agglom_mpi.analysis.summary import summary_table
from agglom_mpi.analysis.warm_start import warm_start
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.searchable import check_search_library, check_searchable
from agglom_mpi.config.yaml_source import CampaignError, parse, warn
from agglom_mpi.contracts.promises import promises_of
from agglom_mpi.display.run_display import Display
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import as_recorded, output_path
from agglom_mpi.runtime.leg import RunRequest
from agglom_mpi.runtime.provenance import sources_digest
from agglom_mpi.runtime.run import run_on_all_ranks
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
