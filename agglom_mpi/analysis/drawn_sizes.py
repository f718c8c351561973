"""Volume fractions of the grains that samples of a file have drawn, where grains differ in size.

A sample draws its sizes first of all from its own random stream, so that they are drawn here again
and nothing is simulated. Large grains jam, so that the completed samples may fill less of the box
than all of them.
"""

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from agglom_mpi.outcome import COMPLETED, FailureReason
from agglom_mpi.physics.size_distributions import SizeLaw, draw_radii
from agglom_mpi.statistics import MeanEstimate, mean_of
from agglom_mpi.variables import volume_fraction

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign
    from agglom_mpi.storage.reader import CampaignData

MAX_GRAINS: Final = 2_000_000
"""Grains of a string whose sizes are drawn again, the first samples of it; a tenth of a second."""


class DrawnFraction(NamedTuple):
    """Volume fractions of the samples of a string.

    Attributes
    ----------
    completed : MeanEstimate
        Of the completed samples, at most as many as have `MAX_GRAINS`.
    wanted : float
        That of the string.
    jammed, samples : int
        Samples that found no place for their grains, and all of the string.
    """

    completed: MeanEstimate
    wanted: float
    jammed: int
    samples: int

    def as_dict(self) -> dict[str, float | int | None]:
        """Return plain values for JSON."""
        return {
            "mean": self.completed.value,
            "standard_error": self.completed.error,
            "wanted": self.wanted,
            "jammed": self.jammed,
        }


def has_sizes(file: "CampaignData") -> bool:
    """Return whether the grains of a file's scene differ in size."""
    return any(key.startswith("scene.sizes.") for key in file.identity)


def drawn_fraction(file: "CampaignData", string: int) -> DrawnFraction | None:
    """Return the volume fractions of a string's samples; None if grains are equal, or none is done.

    Used samples count, and fresh ones, too.
    """
    if not has_sizes(file):
        return None
    # Imported here: a file of equal grains is read without what reads campaigns.
    from agglom_mpi.storage.recorded_campaign import recorded_campaign

    campaign, rows = recorded_campaign(file), file.counted_samples
    rows = rows[rows["string"] == string]
    done = rows["sample"][rows["state"] == COMPLETED]
    if campaign.scene.size_law is None or not len(done):
        return None
    wanted, completed = _drawn(campaign, file.parameters[string], string, done.tolist())
    jammed = int((rows["reason"] == FailureReason.PLACEMENT_JAMMED).sum())
    return DrawnFraction(completed, wanted, jammed, len(rows))


def _drawn(
    campaign: "Campaign", parameters: np.ndarray, string: int, samples: list[int]
) -> tuple[float, MeanEstimate]:
    """Return the volume fraction of a string, and the mean one of its first samples."""
    from agglom_mpi.verbs.simulate import random_numbers

    section, values = campaign.at(parameters)
    law: SizeLaw = section.size_law
    wanted, share = volume_fraction(values["size_ratio"], section.third_moment), []
    count, first = campaign.scene.particles, campaign.first_sample(string)
    for sample in samples[: max(2, MAX_GRAINS // count)]:
        random = random_numbers(campaign, parameters, first + sample)
        cubes = float(np.mean(draw_radii(law, random, count) ** 3))  # ⟨b³⟩/⟨b⟩³
        share.append(wanted / section.third_moment * cubes)
    return wanted, mean_of(share)
