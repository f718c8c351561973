"""Volume fractions of the grains that samples of a file have drawn, where grains differ in size.

A sample draws its sizes first of all from its own random stream, so that they are drawn here again
and nothing is simulated. Large grains jam, so that the completed samples may fill less of the box
than all of them.
"""

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from agglom_mpi.outcome import COMPLETED, FailureReason
from agglom_mpi.physics.size_distributions import draw_radii
from agglom_mpi.statistics import MeanEstimate, mean_of
from agglom_mpi.variables import volume_fraction

if TYPE_CHECKING:
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
    jammed : int
        Number of samples that found no place for their grains.
    """

    completed: MeanEstimate
    wanted: float
    jammed: int

    def as_dict(self) -> dict[str, float | int | None]:
        """Return plain values for JSON."""
        mean, error, _ = self.completed
        numbers = {"standard_error": error, "wanted": self.wanted, "jammed": self.jammed}
        return {"mean": mean, **numbers}


def drawn_fraction(file: "CampaignData", string: int) -> DrawnFraction | None:
    """Return the volume fractions of a string's samples; None if grains are equal, or none is done.

    Used samples count, and fresh ones, too.
    """
    if not any(key.startswith("scene.sizes.") for key in file.identity):
        return None
    # Imported here: a file of equal grains is read without what reads campaigns.
    from agglom_mpi.storage.recorded_campaign import recorded_campaign
    from agglom_mpi.verbs.simulate import random_numbers

    campaign, rows = recorded_campaign(file), file.counted_samples
    rows = rows[rows["string"] == string]
    done = rows["sample"][rows["state"] == COMPLETED].tolist()
    if campaign.scene.size_law is None or not done:
        return None
    parameters = file.parameters[string]
    section, values = campaign.at(parameters)
    wanted, share = volume_fraction(values["size_ratio"], section.third_moment), []
    count, first = campaign.scene.particles, campaign.first_sample(string)
    for sample in done[: max(2, MAX_GRAINS // count)]:
        random = random_numbers(campaign, parameters, first + sample)
        cubes = float(np.mean(draw_radii(section.size_law, random, count) ** 3))  # ⟨b³⟩/⟨b⟩³
        share.append(wanted / section.third_moment * cubes)
    jammed = int((rows["reason"] == FailureReason.PLACEMENT_JAMMED).sum())
    return DrawnFraction(mean_of(share), wanted, jammed)
