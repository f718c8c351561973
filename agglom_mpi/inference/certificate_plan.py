"""Claim of a certificate and the part of a set that it is about, as entries of an identity."""

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple, Self

from agglom_mpi.config.arguments import mistaken_argument, read_fraction
from agglom_mpi.errors import UserError
from agglom_mpi.inference.tolerances import recorded_objective, tolerance_of
from agglom_mpi.search.criteria import Band, Criterion
from agglom_mpi.search.membership import DECISION_ERROR, right_needed, strings_needed
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_campaign

ENTRY: Final = "certificate."
"""Beginning of the entries of an identity that belong to a certificate."""
WOBBLE: Final = "wobble."
"""Beginning of their names that state how much a variable wobbles."""


class CertificateError(UserError, ValueError):
    """There is nothing to certify, or a certificate belongs to something else."""


class CertificatePlan(NamedTuple):
    """Claim about a set, and how it is tested.

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
        By name, the maximum relative deviation of a variable of a string.
    """

    claim: float
    confidence: float
    tolerance: float
    strings: int
    max_samples: int
    seed: int
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
                raise mistaken_argument(data.path, f"robust {name}", message)
        wobble = {name: _share(data, f"robust {name}", robust[name]) for name in sorted(robust)}
        plan = cls(**values, wobble=wobble)
        if plan.right_needed is None:
            enough = strings_needed(1.0, plan.claim, plan.confidence, DECISION_ERROR)
            if enough is None:
                message = f"is {plan.claim:g}; no number of strings can show it"
                raise mistaken_argument(data.path, "claim", message)
            message = f"is {plan.strings}; must be at least {enough} for this claim and confidence"
            raise mistaken_argument(data.path, "strings", message)
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


def _share(data: CampaignData, field: str, value: Any) -> float:
    """Return a fraction between 0 and 1, both excluded; raise an ArgumentError for others."""
    try:
        return read_fraction(value)
    except ValueError as error:
        raise mistaken_argument(data.path, field, error) from None
