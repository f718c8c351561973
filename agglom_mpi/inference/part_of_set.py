"""The part of a set that a certificate is about, as entries of an identity."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

from agglom_mpi.config.plan import ENTRY
from agglom_mpi.errors import UserError
from agglom_mpi.inference.tolerances import recorded_objective
from agglom_mpi.search.criteria import Band, Criterion
from agglom_mpi.storage.reader import CampaignData


class CertificateError(UserError, ValueError):
    """There is nothing to certify, or a certificate belongs to something else."""


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
