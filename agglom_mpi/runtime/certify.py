"""Certificates: strings drawn from a feasible set, judged by fresh samples.

They are the strings of a campaign file of its own, run as any other: on ranks, and continued by the
same command after a stop or a kill. That is `agglom certify`, or `agglom-invert` of a campaign with
a section `certify`.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.arguments import mistaken_argument
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.plan import ENTRY, CertificatePlan, Output
from agglom_mpi.config.user_function import UserFunction, read_function
from agglom_mpi.declaration.declared import FieldError, raise_field_errors
from agglom_mpi.display.run_display import StudyDisplay
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.errors import CodeNotAllowedError
from agglom_mpi.formatting import format_percent
from agglom_mpi.inference.certificate import (
    certificate_path,
    membership_test,
    read_certificate,
    refuse_damage,
    samples_digest,
    verdict_of,
)
from agglom_mpi.inference.certified_part import (
    SAMPLE_STREAM,
    CertificateError,
    CertifiedPart,
    PartOfSet,
    certified_part,
)
from agglom_mpi.inference.feasible_set import feasible_set
from agglom_mpi.outcome import SampleSummary
from agglom_mpi.random_streams import CERTIFICATE as CERTIFICATE_STREAM
from agglom_mpi.random_streams import search_stream
from agglom_mpi.runtime.experiment import GivenStrings, SampleSetup
from agglom_mpi.runtime.file_setup import check_writable
from agglom_mpi.runtime.leg import RunRequest
from agglom_mpi.runtime.run import run_on_all_ranks
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.membership import MembershipTest, Verdict
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.search.stopping import FixedNumber
from agglom_mpi.storage.reader import CampaignData, read_inversion
from agglom_mpi.storage.recorded_campaign import recorded_campaign, recorded_objective
from agglom_mpi.storage.room import TableSizes, table_sizes
from agglom_mpi.storage.schema import CERTIFICATE

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


class CertifyOptions(NamedTuple):
    """Options of `agglom certify`, as `cli/certify.py` declares them."""

    file: str
    plan: Mapping[str, Any]
    """Keys of the section `certify` that are given, with their values."""
    max_walltime: float | None = None
    quiet: bool = False
    accept_code_change: bool = False
    database: str | None = None
    allow_code: bool = False


class JudgedEnsemble(Ensemble):
    """The samples of a string until they decide whether it is right.

    It asks for no more samples than the next look needs.
    """

    def __init__(self, test: MembershipTest, objective: Objective, particles: int) -> None:
        super().__init__(FixedNumber(samples=test.looks[-1]), objective, particles)
        self.max_samples = test.looks[0]
        self._test = test
        self._numbers: list[tuple[float, ...]] = []

    @property
    def follows_means(self) -> bool:
        """False: its numbers are kept."""
        return False

    def add(self, outcome: SampleSummary) -> None:
        """Take the next sample."""
        super().add(outcome)
        if outcome.completed:
            self._numbers.append(outcome.quantities)
        looks, used = self._test.looks, self.samples_used
        if used < self.max_samples:
            self.finished = False  # failures do not end it between looks
            return
        verdict = self._test.verdict(np.array(self._numbers), self.failed)
        if verdict is Verdict.UNDECIDED and used < looks[-1]:
            self.max_samples, self.finished = looks[looks.index(used) + 1], False


class Certification(GivenStrings):
    """Strings that fresh samples test.

    Parameters
    ----------
    data
        The finished campaign.
    campaign
        The same, with its code.
    plan
        What is claimed.
    found
        The part that is tested, and its strings.

    Attributes
    ----------
    of, path
        The campaign file, and that of the certificate.
    """

    purpose = CERTIFICATE
    end = "all strings are judged"

    def __init__(
        self, data: CampaignData, campaign: Campaign, plan: CertificatePlan, found: CertifiedPart
    ) -> None:
        stream = search_stream(plan.seed, CERTIFICATE_STREAM, SAMPLE_STREAM, campaign.seed)
        fresh = campaign.with_seed(int(stream.integers(1 << 62)))
        self.campaign = replace(fresh, output=Output(), final=None)
        self.max_failures = campaign.stopping.max_failures
        self.max_seconds = campaign.stopping.max_seconds
        (part, self.strings), self.of, self.path = found, data.path, certificate_path(data.path)
        self._test = membership_test(data, plan, part)
        self._entries = plan.recorded_entries() | part.entries()
        self._entries[f"{ENTRY}of"] = samples_digest(data)

    @property
    def table_sizes(self) -> TableSizes:
        """Sizes of the tables: one generation of all strings."""
        count, samples = len(self.strings), self._test.looks[-1]
        sizes = table_sizes(self.campaign)
        return sizes._replace(strings=count, max_samples=samples, generations=1, population=count)

    @property
    def largest(self) -> str:
        """The extent of the certificate, as text."""
        return f"certificate by {len(self.strings)} strings"

    def identity(self) -> dict[str, object]:
        """Return the campaign's own, with the claim and the part."""
        return self.campaign.identity() | self._entries

    def setup(self, string: int) -> SampleSetup:
        """Return the campaign's scene."""
        return SampleSetup(self.campaign)

    def ensemble(self, string: int) -> Ensemble:
        """Return what takes the samples of a string until they decide."""
        objective = self.campaign.objective_at(self.strings[string])
        return JudgedEnsemble(self._test, objective, self.campaign.scene.particles)

    def summaries(self, rows: NDArray[np.void]) -> list[SampleSummary]:
        """Return summaries of samples with the numbers that are compared as their quantities."""
        numbers = self._test.criterion.numbers(rows, self.campaign.scene.particles).tolist()
        found = zip(self.campaign.objective.summaries(rows), numbers, strict=True)
        return [summary._replace(quantities=tuple(own)) for summary, own in found]


def certify(options: CertifyOptions, world: "Intracomm | None") -> int:
    """Certify a set on all ranks; return the exit code."""
    display = StudyDisplay(options.quiet)

    def read() -> RunRequest:
        data = read_inversion(options.file, options.allow_code)
        plan = stated_plan(data, options.plan)
        found = certification(data, plan, display.message)
        return RunRequest(found, found.path, options.accept_code_change, options.database)

    def finish(request: RunRequest) -> None:
        if not options.quiet:
            display.table(verdict_text(request, options.allow_code))

    return run_on_all_ranks(read, display, finish, world, max_walltime=options.max_walltime)


def verdict_text(request: RunRequest, allow_code: bool) -> str:
    """Return what a finished certification proves, line by line."""
    assert isinstance(request.experiment, Certification)
    data = read_inversion(request.experiment.of, allow_code)
    return verdict_of(data, read_certificate(data)).text


def stated_plan(data: CampaignData, given: Mapping[str, Any]) -> CertificatePlan:
    """Return the plan that options state for a file; what they leave out is as in its campaign.

    Raises
    ------
    ArgumentError
        If a value is impossible, or the strings are too few for the claim.
    """
    campaign = recorded_campaign(data)
    stated = campaign.required_plan.certify or CertificatePlan()
    try:
        plan = CertificatePlan.checked({**dict(stated), **given})
        searched = [variable.name for variable in campaign.variables.own]
        raise_field_errors(plan.misfits(recorded_objective(data), searched))
    except FieldError as error:
        path, message = error.problems[0]
        raise mistaken_argument(data.path, ".".join(map(str, path)), message) from None
    return plan


def certification(
    data: CampaignData,
    plan: CertificatePlan,
    show: Callable[[str], None],
    function: UserFunction | None = None,
) -> Certification:
    """Return the certification of a file, begun or not.

    Parameters
    ----------
    show
        Called with lines on the part that is chosen.
    function
        That of the objective; by default, the one beside the file.

    Raises
    ------
    UserError, OSError
        If there is no set, or no such certificate of it is possible.
    """
    if (state := data.status().state) != "finished":
        raise CertificateError(f"{data.path}: is {state}; must be finished to be certified")
    refuse_damage(data)
    campaign = runnable_campaign(data, function)
    path = certificate_path(data.path)
    check_writable(path)
    found = begun_part(data, plan, path) if path.exists() else None
    if found is None:
        show(f"choosing the part of the set of {data.path} to certify")
        part, _ = found = part_of_set(data, plan)
        share, chance = format_percent(part.share, 3), format_percent(part.expected)
        show(
            f"strings with P ≥ {part.least_probability:.3g}, {share} of the box; the "
            f"emulator expects the claim to be shown with a probability of {chance}"
        )
    return Certification(data, campaign, plan, found)


def runnable_campaign(data: CampaignData, known: UserFunction | None = None) -> Campaign:
    """Return the campaign of a file, with its function, by default that of the module beside it.

    Raises
    ------
    CodeNotAllowedError
        If the objective is a function that may not run.
    CertificateError
        If its module is absent, or another one.
    """
    campaign = recorded_campaign(data)
    call, function = campaign.objective.code, campaign.user_function
    if call is None or function is None:
        return campaign
    if not data.allow_code:
        raise CodeNotAllowedError(f"{data.path} has code of its own ({call}); --allow-code runs it")
    try:
        beside = known or read_function(data.path.parent, call)
    except ValueError as error:
        raise CertificateError(f"{data.path}: objective: {error}") from None
    known_module, module = function.module, beside.module
    if module.sha256 != known_module.sha256:
        raise CertificateError(
            f"{data.path}: objective: {module.file} was edited since the campaign was run"
        )
    read = module._replace(values=known_module.values)
    return replace(campaign, user_function=UserFunction(function.call, read))


def begun_part(data: CampaignData, plan: CertificatePlan, path: Path) -> CertifiedPart | None:
    """Return the part and strings of a certificate that was begun; None if it has no strings yet.

    Raises
    ------
    CertificateError
        If it is another one.
    """
    file = read_certificate(data)
    begun = CertificatePlan.of_identity(file.identity)
    if begun != plan:
        raise CertificateError(
            f"{path}: is a certificate with {begun.text}; not with {plan.text}. A set is tested "
            "once: of several certificates, none has its confidence. Move the file away to test "
            "anew"
        )
    known = file.parameters
    if len(known) < plan.strings:
        return None
    strings = np.array([known[string] for string in range(plan.strings)])
    return PartOfSet.of_entries(file.identity), strings


@single_threaded
def part_of_set(data: CampaignData, plan: CertificatePlan) -> CertifiedPart:
    """Return the part of the set of a file that is certified, and its strings; errors as above."""
    found = feasible_set(data, plan.tolerance, plan.robust)
    if found.empty:
        raise CertificateError(
            f"{data.path}: the set is empty, so nothing can be certified; nearest {found.nearest}"
        )
    return certified_part(found.emulated, found.points, plan)
