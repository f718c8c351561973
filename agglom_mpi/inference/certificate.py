"""A certificate of a feasible set: what fresh runs prove of a part of it.

`agglom certify FILE.h5` writes `FILE.certificate.h5`, a campaign file whose strings were drawn
evenly from the part. Its identity states the claim, the part, and the digest of the samples that
the part follows from. The verdict is computed from its rows here.
"""

import hashlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

from agglom_mpi.config.arguments import read_fraction
from agglom_mpi.errors import UserError
from agglom_mpi.formatting import format_percent, pluralise
from agglom_mpi.inference.tolerances import recorded_objective, tolerance_of
from agglom_mpi.outcome import COLUMNS, COMPLETED
from agglom_mpi.search.criteria import Band, Criterion
from agglom_mpi.search.membership import (
    DECISION_ERROR,
    MembershipTest,
    Verdict,
    largest_share,
    least_share,
    looks_until,
    right_needed,
    strings_needed,
)
from agglom_mpi.storage.reader import CampaignData, read_campaign
from agglom_mpi.storage.recorded_campaign import recorded_campaign
from agglom_mpi.storage.schema import CERTIFICATE, parameters_of

STRINGS: Final = 100
"""Default number of strings that are drawn."""
MAX_SAMPLES: Final = 2560
"""Default maximum number of samples of a string."""
ENTRY: Final = "certificate."
"""Beginning of the entries of an identity that belong to a certificate."""
WOBBLE: Final = "wobble."
"""Beginning of their names that state how much a variable wobbles."""


class CertificateError(UserError, ValueError):
    """There is nothing to certify, or a certificate belongs to something else."""


class CertificatePlan(NamedTuple):
    """What is claimed of a set, and how it is tested.

    Attributes
    ----------
    claim
        Share of the part that is claimed to be right.
    confidence
        Of the bounds.
    tolerance
        Of the set.
    strings
        Number of strings that are drawn.
    max_samples
        Maximum number of samples of each.
    seed
        Seed of the strings and of their samples.
    wobble
        By name, the share of itself by which a variable of a string wobbles at most.
    """

    claim: float
    confidence: float
    tolerance: float
    strings: int = STRINGS
    max_samples: int = MAX_SAMPLES
    seed: int = 1
    wobble: Mapping[str, float] = {}

    @classmethod
    def of_arguments(cls, data: CampaignData, robust: Mapping[str, Any], **given: Any) -> Self:
        """Return the plan that arguments state for the set of a file.

        Parameters
        ----------
        data
        robust
            By name, how much a variable wobbles, such as `"5%"`.
        given
            The other attributes; claim, confidence and tolerance also as texts.

        Raises
        ------
        ArgumentError
            If one is impossible, or the strings are too few for the claim.
        """
        shares = {name: _share(data, name, given[name]) for name in ("claim", "confidence")}
        values = {**given, **shares, "tolerance": tolerance_of(data, given["tolerance"])}
        names = [variable.name for variable in recorded_campaign(data).variables.own]
        for name in robust:
            if name not in names:
                message = f"is no searched variable; allowed: {', '.join(names)}"
                raise _mistaken(data, f"robust {name}", message)
        wobble = {name: _share(data, f"robust {name}", robust[name]) for name in sorted(robust)}
        plan = cls(**values, wobble=wobble)
        if plan.right_needed is None:
            enough = strings_needed(1.0, plan.claim, plan.confidence, DECISION_ERROR)
            if enough is None:
                message = f"is {plan.claim:g}; no number of strings can show it"
                raise _mistaken(data, "claim", message)
            message = f"is {plan.strings}; must be at least {enough} for this claim and confidence"
            raise _mistaken(data, "strings", message)
        return plan

    @property
    def right_needed(self) -> int | None:
        """Number of strings that must be right for the claim to hold; None if all do not do."""
        return right_needed(self.strings, self.claim, self.confidence, DECISION_ERROR)

    def entries(self) -> dict[str, object]:
        """Return it as entries of an identity."""
        numbers = {ENTRY + name: value for name, value in self._asdict().items()}
        del numbers[f"{ENTRY}wobble"]
        return numbers | {ENTRY + WOBBLE + name: share for name, share in self.wobble.items()}

    @classmethod
    def of_entries(cls, identity: Mapping[str, Any]) -> Self:
        """Return the plan of an identity."""
        start = ENTRY + WOBBLE
        wobble = {n.removeprefix(start): v for n, v in identity.items() if n.startswith(start)}
        return cls(**{n: identity[ENTRY + n] for n in cls._fields[:-1]}, wobble=wobble)

    @property
    def text(self) -> str:
        """The plan in words."""
        wobble = "".join(f", robust {name}={share:g}" for name, share in self.wobble.items())
        return (
            f"claim {self.claim:g}, confidence {self.confidence:g}, tolerance {self.tolerance:g}, "
            f"{self.strings} strings of at most {self.max_samples} samples, seed {self.seed}"
            f"{wobble}"
        )


class PartOfSet(NamedTuple):
    """The part of a set that a certificate is about.

    Attributes
    ----------
    least_probability
        The part is all strings that are members with at least this probability; where values
        wobble, on average over the wobble.
    share
        Its share of what is allowed of the box.
    allowed
        Share of the box that the constraints allow.
    expected
        Probability by the emulator that the claim would be shown.
    least_mean
        Least mean growth of a right string, where members are those near a maximum: the share of
        the emulated maximum. nan otherwise.
    """

    least_probability: float
    share: float
    allowed: float
    expected: float
    least_mean: float = math.nan

    def entries(self) -> dict[str, object]:
        """Return it as entries of an identity, without what is nan."""
        return {ENTRY + n: v for n, v in self._asdict().items() if not math.isnan(v)}

    @classmethod
    def of_entries(cls, identity: Mapping[str, Any]) -> Self:
        """Return the part of an identity."""
        return cls(*(float(identity.get(ENTRY + name, math.nan)) for name in cls._fields))

    def criterion(self, data: CampaignData, tolerance: float) -> Criterion:
        """Return what makes a string of the campaign of a file right."""
        criterion = recorded_objective(data).criterion(tolerance)
        if math.isnan(self.least_mean):
            return criterion
        text = f"mean b/b0 at least {self.least_mean:.4g}, near the emulated maximum"
        return Band("mean_radius_ratio", self.least_mean, math.inf, text)


class Certificate(NamedTuple):
    """What fresh runs prove of a part of a feasible set.

    Attributes
    ----------
    plan : CertificatePlan
        The claim, and how it was tested.
    part : PartOfSet
        The part of the set.
    criterion : str
        What makes a string right.
    right, wrong, undecided : int
        Number of strings that were decided to be right, wrong, or neither.
    samples : int
        Number of fresh samples that decided.
    error_of_right : float
        Largest probability that a right string was decided to be wrong.
    path : str
        The file with the strings and their samples.
    """

    plan: CertificatePlan
    part: PartOfSet
    criterion: str
    right: int
    wrong: int
    undecided: int
    samples: int
    error_of_right: float
    path: str

    @property
    def finished(self) -> bool:
        """Whether all strings were judged; before, nothing is proved."""
        return self.right + self.wrong + self.undecided == self.plan.strings

    @property
    def least_share(self) -> float:
        """Lower bound of the share of the part that is right, with the confidence of the plan."""
        confidence = self.plan.confidence
        return least_share(self.right, self.plan.strings, confidence, DECISION_ERROR)

    @property
    def largest_share(self) -> float:
        """Upper bound of the same, with that confidence on its own."""
        possible, strings = self.right + self.undecided, self.plan.strings
        return largest_share(possible, strings, self.plan.confidence, self.error_of_right)

    @property
    def holds(self) -> bool:
        """Whether the claim is shown."""
        return self.finished and self.least_share >= self.plan.claim

    @property
    def refuted(self) -> bool:
        """Whether the opposite of the claim is shown."""
        return self.finished and self.largest_share < self.plan.claim

    @property
    def strings_for_claim(self) -> int | None:
        """Number of strings that would show the claim if as large a share were right; else None."""
        share = self.right / self.plan.strings
        return strings_needed(share, self.plan.claim, self.plan.confidence, DECISION_ERROR)

    @property
    def least_share_of_four(self) -> float:
        """Lower bound if four times as many strings were drawn and as large a share were right."""
        plan = self.plan
        return least_share(4 * self.right, 4 * plan.strings, plan.confidence, DECISION_ERROR)

    def lines(self) -> list[str]:
        """Return it as sentences, the verdict first."""
        plan = self.plan
        if not self.finished:
            judged = self.right + self.wrong + self.undecided
            return [
                f"not finished: {judged} of {plan.strings} strings are judged; agglom certify with "
                "the same options continues"
            ]
        box = "the box" if self.part.allowed == 1.0 else "the allowed part of the box"
        part = f"{100.0 * self.part.share:.3g} % of {box}"
        what = f"of these {part} are right"
        if plan.wobble:
            wobbles = " and ".join(
                f"{n} is off by up to {100 * s:.3g} %" for n, s in plan.wobble.items()
            )
            what += f" where {wobbles}"
        confidence = f"with {format_percent(plan.confidence)} confidence"
        bound = _rounded_down(self.least_share)
        fresh = f"{self.right} of {plan.strings} fresh strings"
        claim = format_percent(plan.claim)
        verdict = f"the claim of {claim} is shown"
        if self.refuted:
            most = 100.0 - 100.0 * _floor(1.0 - self.largest_share)
            verdict = f"the claim of {claim} is refuted: at most {most:.1f} % are right"
        elif not self.holds:
            verdict = f"the claim of {claim} is not shown"
        return [
            f"at least {bound} {what}, {confidence}: {fresh}",
            f"{verdict}; {self.wrong} wrong, {self.undecided} undecided, "
            f"by {self.samples:,} samples, seed {plan.seed}",
            f"the part: P ≥ {self.part.least_probability:.3g}; right: {self.criterion}",
            self._more,
        ]

    @property
    def _more(self) -> str:
        """What more strings would give."""
        if self.holds:
            more, strings = _rounded_down(self.least_share_of_four), 4 * self.plan.strings
            return f"{pluralise(strings, 'string')} of which as many are right would show {more}"
        if self.strings_for_claim is None:
            return "more strings of which as many are right would not show the claim"
        more = pluralise(self.strings_for_claim, "string")
        return f"{more} of which as many are right would show the claim"

    @property
    def text(self) -> str:
        """The sentences, a line each."""
        return "\n".join(self.lines())

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values for JSON; bounds of an unfinished one are None."""
        found = self._asdict() | {"plan": self.plan._asdict() | {"wobble": dict(self.plan.wobble)}}
        found["part"] = self.part._asdict()
        found |= {name: getattr(self, name) for name in ("finished", "holds", "refuted")}
        bounds = "least_share", "largest_share", "least_share_of_four", "strings_for_claim"
        known = {name: getattr(self, name) if self.finished else None for name in bounds}
        return found | known | {"text": self.lines()}


def certificate_path(path: Path) -> Path:
    """Return the file of the certificate of a campaign file."""
    return path.with_suffix(".certificate.h5")


def certificate_of(data: CampaignData) -> Certificate | None:
    """Return the certificate that lies beside a campaign file; None if there is none.

    Raises
    ------
    CertificateError
        If it is that of other samples.
    NotACampaign, OSError
        If it cannot be read.
    """
    path = certificate_path(data.path)
    return verdict_of(data, read_certificate(data)) if path.exists() else None


def read_certificate(data: CampaignData) -> CampaignData:
    """Return the file of the certificate of a campaign file; errors as of `certificate_of`."""
    path = certificate_path(data.path)
    file = read_campaign(path, data.allow_code)
    if file.attributes.get("purpose") != CERTIFICATE:
        raise CertificateError(f"{path}: is no certificate; move it away to certify {data.path}")
    if file.identity.get(f"{ENTRY}of") != evidence(data):
        raise CertificateError(
            f"{path}: certifies a set that rests on other samples than those of {data.path}; move "
            "it away to certify anew"
        )
    return file


def verdict_of(data: CampaignData, file: CampaignData) -> Certificate:
    """Return what the file of a certificate proves of the set of a campaign file."""
    plan, part = CertificatePlan.of_entries(file.identity), PartOfSet.of_entries(file.identity)
    test = membership_test(data, plan, part)
    particles, verdicts = recorded_campaign(data).scene.particles, []
    samples = 0
    file.all_sample_rows()  # read once: without, each string opens the file
    for string, used in file.samples_used.items():
        rows = file.sample_rows(string)
        rows = rows[(rows["sample"] < used) & (rows["state"] == COMPLETED)]
        verdicts.append(test.verdict(test.criterion.numbers(rows, particles), used - len(rows)))
        samples += used
    return Certificate(
        *(plan, part, test.criterion.text),
        right=verdicts.count(Verdict.RIGHT),
        wrong=verdicts.count(Verdict.WRONG),
        undecided=verdicts.count(Verdict.UNDECIDED),
        samples=samples,
        error_of_right=test.error_of_right,
        path=str(file.path),
    )


def membership_test(data: CampaignData, plan: CertificatePlan, part: PartOfSet) -> MembershipTest:
    """Return the test of a string of the set of a file."""
    criterion = part.criterion(data, plan.tolerance)
    return MembershipTest(criterion, looks_until(plan.max_samples))


def evidence(data: CampaignData) -> str:
    """Return the digest of what the set of a file rests on, 32 hexadecimal digits.

    These are the campaign, its strings, and the results of their used and fresh samples.
    """
    found = hashlib.blake2b(data.attributes["campaign_sha256"].encode(), digest_size=16)
    rows = data.all_sample_rows()
    rows = rows[data.are_used(rows) | (rows["sample"] >= data.fresh_from)]
    found.update(parameters_of(data.string_rows()).astype("<f8").tobytes())
    names = {"string", "sample", *(column.name for column in COLUMNS), *data.sizes.quantities}
    for name in rows.dtype.names or ():
        if name in names:
            found.update(rows[name].astype(rows[name].dtype.newbyteorder("<")).tobytes())
    return found.hexdigest()


def _floor(share: float) -> float:
    """Return a share rounded down to tenths of a percent."""
    return math.floor(1000.0 * share + 1e-9) / 1000.0


def _rounded_down(share: float) -> str:
    return f"{100.0 * _floor(share):.1f} %"


def _share(data: CampaignData, field: str, value: Any) -> float:
    """Return a fraction between 0 and 1, both excluded; raise an ArgumentError for others."""
    try:
        return read_fraction(value)
    except ValueError as error:
        raise _mistaken(data, field, error) from None


def _mistaken(data: CampaignData, field: str, message: object) -> Exception:
    from agglom_mpi.config.yaml_source import ArgumentError  # loads the reader of YAML

    return ArgumentError.of(data.path, field, message)
