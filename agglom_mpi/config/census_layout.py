"""When the samples of a campaign are counted by size, and in which classes: by its data."""

import math
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Final

from agglom_mpi.measurements.layout import CensusLayout

if TYPE_CHECKING:
    from agglom_mpi.config.campaign_sections import CampaignSections

SAMPLES_OF_SIZES: Final = 16
"""Samples of a string whose grains are drawn to see how small and large they can be."""

MARGIN: Final = 1.2
"""Sizes may lie outside those drawn by this factor; the classes at the ends take what is beyond."""


def census_layout(campaign: "CampaignSections") -> CensusLayout | None:
    """Return the layout of the censuses of a campaign's samples; None where it has no data."""
    if not campaign.data:
        return None
    times = {math.inf if datum.time is None else datum.time for datum in campaign.data}
    volume = max(campaign.final.larger, default=1) if campaign.final else 1
    largest = (volume * campaign.most_grains) ** (1.0 / 3.0)
    drawn = list(_drawn_radii(campaign))
    smallest = min([1.0, *(low / MARGIN for low, _ in drawn)])
    largest = max([largest, *(high * MARGIN for _, high in drawn)])
    return CensusLayout.between(tuple(sorted(times)), smallest, largest)


def _drawn_radii(campaign: "CampaignSections") -> Iterator[tuple[float, float]]:
    """Yield the smallest and largest b/b⁰ of grains of some samples; none where all are equal."""
    from agglom_mpi.config.simulate import random_numbers
    from agglom_mpi.simulation.sample import initial_radii

    box = campaign.variables
    if campaign.scene.sizes is None:
        return
    for string in (box.lower, 0.5 * (box.lower + box.upper), box.upper):
        with suppress(ValueError):  # a law refuses the numbers together
            scene = campaign.at(string).build()
            for k in range(SAMPLES_OF_SIZES):
                radii = initial_radii(scene, partial(random_numbers, campaign, string, k))
                yield float(radii.min()), float(radii.max())
