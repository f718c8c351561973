"""When the samples of a campaign are counted by size, and in which classes: by its data."""

import math
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, Final

from agglom_mpi.measurements.datum import data_times
from agglom_mpi.measurements.layout import CensusLayout
from agglom_mpi.physics.size_distributions import draw_radii
from agglom_mpi.random_streams import sample_stream

SAMPLES_OF_SIZES: Final = 16
"""Samples of a string whose grains are drawn to see how small and large they can be."""

MARGIN: Final = 1.2
"""Sizes may lie outside those drawn by this factor; the classes at the ends take what is beyond."""


def census_layout(campaign: Any) -> CensusLayout | None:
    """Return the layout of the censuses of a campaign's samples; None where it has no data.

    Parameters
    ----------
    campaign
        The `Campaign`.
    """
    if not (campaign.data or campaign.has_layout):
        return None
    times = [math.inf if time is None else time for time in data_times(campaign.data)]
    volume = max(campaign.final.larger, default=1) if campaign.final else 1
    largest = (volume * campaign.most_grains) ** (1.0 / 3.0)
    drawn = list(_drawn_radii(campaign))
    smallest = min([1.0, *(low / MARGIN for low, _ in drawn)])
    largest = max([largest, *(high * MARGIN for _, high in drawn)])
    return CensusLayout.between(tuple(times), smallest, largest)


def _drawn_radii(campaign: Any) -> Iterator[tuple[float, float]]:
    """Yield the smallest and largest b/b⁰ of grains of some samples; none where all are equal."""
    box = campaign.variables
    if campaign.scene.sizes is None:
        return
    for string in (box.lower, 0.5 * (box.lower + box.upper), box.upper):
        with suppress(ValueError):  # a law refuses the numbers together
            scene = campaign.at(string).build()
            for k in range(SAMPLES_OF_SIZES):
                random = sample_stream(campaign.seed, box.stream_key(string), k)
                radii = draw_radii(scene.sizes, random, scene.particles)
                yield float(radii.min()), float(radii.max())
