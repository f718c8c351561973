"""A certificate of a feasible set: what fresh runs prove of a part of it.

`agglom certify FILE.h5` writes `FILE.certificate.h5`, a campaign file whose strings were drawn
evenly from the part. Its identity states the claim, the part, and the digest of the samples that
the part follows from. The verdict is computed from its rows here.
"""

import hashlib
import math
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.config.plan import ENTRY, CertificatePlan, deviations_text
from agglom_mpi.formatting import format_percent, pluralise
from agglom_mpi.inference.certified_part import CertificateError, PartOfSet
from agglom_mpi.inference.stored_samples import stored_samples
from agglom_mpi.outcome import COLUMNS, COMPLETED
from agglom_mpi.search.membership import (
    DECISION_ERROR,
    MembershipTest,
    Verdict,
    extreme_numbers,
    largest_share,
    least_share,
    looks_until,
    strings_needed,
)
from agglom_mpi.storage.reader import CampaignData, read_campaign
from agglom_mpi.storage.recorded_campaign import recorded_campaign
from agglom_mpi.storage.schema import CERTIFICATE, LEARNED_STRING, parameters_of

MOST_DEVIATIONS: Final = 0.8
"""Share of its deviations for which a string has to be right to be called robust."""


class Certificate(NamedTuple):
    """Bounds on the right share of a part of a feasible set, by fresh runs.

    Where values wobble, each string was judged at one drawn deviation, and what is counted are such
    pairs of a string and a deviation.

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
        """Lower bound of the share of the part that is right, with the confidence of the plan.

        Where values wobble, that is the share of the pairs of a string and a deviation.
        """
        confidence = self.plan.confidence
        return least_share(self.right, self.plan.strings, confidence, DECISION_ERROR)

    @property
    def least_share_of_robust(self) -> float:
        """Lower bound of the share of strings right for `MOST_DEVIATIONS` of their deviations.

        With the same confidence. It follows from the share c of right pairs by Markov's inequality:
        if a share w of the strings is wrong for more than a share ε of their deviations, then
        1 − c > w·ε. Without deviations it is the lower bound itself.
        """
        if not self.plan.robust:
            return self.least_share
        return max(0.0, 1.0 - (1.0 - self.least_share) / (1.0 - MOST_DEVIATIONS))

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
                f"not finished: {judged} of {plan.strings} strings are judged; the same "
                "command continues"
            ]
        box = "the box" if self.part.allowed == 1.0 else "the allowed part of the box"
        part = f"{100.0 * self.part.share:.3g} % of {box}"
        confidence = f"with {format_percent(plan.confidence)} confidence"
        fresh = f"{self.right} of {plan.strings} fresh {self._unit}s"
        what = f"of these {part}"
        if plan.robust:
            what = f"of the pairs of a string of these {part} and a deviation"
        claim = f"the claim of {format_percent(plan.claim)}" + " of the pairs" * bool(plan.robust)
        verdict = f"{claim} is shown"
        if self.refuted:
            most = 100.0 - 100.0 * _floor(1.0 - self.largest_share)
            verdict = f"{claim} is refuted: at most {most:.1f} % are right"
        elif not self.holds:
            verdict = f"{claim} is not shown"
        return [
            f"at least {_rounded_down(self.least_share)} {what} are right, {confidence}: {fresh}",
            *self._of_deviations,
            f"{verdict}; {self.wrong} wrong, {self.undecided} undecided, "
            f"by {self.samples:,} samples, seed {plan.seed}",
            f"the part: P ≥ {self.part.least_probability:.3g}; right: {self.criterion}",
            self._more,
        ]

    @property
    def _unit(self) -> str:
        """Noun for what a verdict is about."""
        return "pair" if self.plan.robust else "string"

    @property
    def _of_deviations(self) -> list[str]:
        """The deviations of the pairs, and what follows for strings."""
        if not self.plan.robust:
            return []
        most, strings = f"{100 * MOST_DEVIATIONS:.0f} %", self.least_share_of_robust
        known = f"at least {_rounded_down(strings)} of these strings are"
        if strings == 0.0:
            known = "it is not shown that any of these strings are"
        return [
            f"deviations: {deviations_text(self.plan.robust)}, even, ending at the edge of the "
            "box; one was drawn for each string",
            f"{known} right for at least {most} of their deviations (Markov's inequality)",
        ]

    @property
    def _more(self) -> str:
        """Sentence on the result of more strings."""
        if self.holds:
            more, strings = _rounded_down(self.least_share_of_four), 4 * self.plan.strings
            return f"{pluralise(strings, self._unit)} of which as many are right would show {more}"
        if self.strings_for_claim is None:
            return f"more {self._unit}s of which as many are right would not show the claim"
        more = pluralise(self.strings_for_claim, self._unit)
        return f"{more} of which as many are right would show the claim"

    @property
    def text(self) -> str:
        """The sentences, a line each."""
        return "\n".join(self.lines())

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values for JSON; bounds of an unfinished one are None."""
        found = self._asdict() | {"plan": dict(self.plan), "part": self.part._asdict()}
        found |= {name: getattr(self, name) for name in ("finished", "holds", "refuted")}
        found["counted"] = f"{self._unit}s"
        bounds = (
            *("least_share", "largest_share", "least_share_of_four", "strings_for_claim"),
            "least_share_of_robust",
        )
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
        If it is that of other samples, or rows of either file are damaged.
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
    if file.identity.get(f"{ENTRY}of") != samples_digest(data):
        raise CertificateError(
            f"{path}: certifies a set that rests on other samples than those of {data.path}; move "
            "it away to certify anew"
        )
    return file


def verdict_of(data: CampaignData, file: CampaignData) -> Certificate:
    """Return what the file of a certificate proves of the set of a campaign file.

    Raises
    ------
    CertificateError
        If rows of either file are damaged.
    """
    for each in (data, file):
        refuse_damage(each)
    plan, part = CertificatePlan.of_identity(file.identity), PartOfSet.of_entries(file.identity)
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
    criterion, rows = part.criterion(data, plan.tolerance), stored_samples(data).rows
    numbers = criterion.numbers(rows, recorded_campaign(data).scene.particles)
    return MembershipTest(criterion, looks_until(plan.max_samples), extreme_numbers(numbers))


def refuse_damage(data: CampaignData) -> None:
    """Raise a CertificateError if rows of a file have a wrong checksum."""
    if data.damaged:
        rows = pluralise(data.damaged, "damaged row")
        raise CertificateError(
            f"{data.path}: has {rows}, so nothing can be certified; agglom check {data.path} shows "
            "which, and whether the same command as before simulates them again"
        )


def samples_digest(data: CampaignData) -> str:
    """Return the digest of what the set of a file rests on, 32 hexadecimal digits.

    These are the campaign, its strings, and the results of their used and fresh samples; then the
    same of what it learned.
    """
    found = hashlib.blake2b(data.attributes["campaign_sha256"].encode(), digest_size=16)
    rows = data.all_sample_rows()
    rows = rows[data.are_used(rows) | (rows["sample"] >= data.fresh_from)]
    strings = data.string_rows()
    strings = strings[np.isin(strings["string"], rows["string"])]  # without those proposed ahead
    found.update(parameters_of(strings).astype("<f8").tobytes())
    names = {"string", "sample", *(column.name for column in COLUMNS), *data.sizes.quantities}
    for part in (rows,) if (learned := data.learned_rows()) is None else (rows, learned):
        for name in part.dtype.names or ():
            if name in names | {LEARNED_STRING}:
                found.update(part[name].astype(part[name].dtype.newbyteorder("<")).tobytes())
    return found.hexdigest()


def _floor(share: float) -> float:
    """Return a share rounded down to tenths of a percent."""
    return math.floor(1000.0 * share + 1e-9) / 1000.0


def _rounded_down(share: float) -> str:
    return f"{100.0 * _floor(share):.1f} %"
