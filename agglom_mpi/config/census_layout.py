"""Measured data of a campaign for samples, and times and size classes of their censuses."""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

from numpy.typing import ArrayLike

from agglom_mpi.config.data_section import fixed_end
from agglom_mpi.measurements.datum import absent_time, data_times, exact_values
from agglom_mpi.measurements.layout import CensusLayout, Layouts, layout_of
from agglom_mpi.physics.scales import grain_radius
from agglom_mpi.physics.size_distributions import draw_radii
from agglom_mpi.random_streams import sample_stream
from agglom_mpi.search.objectives.misfit import Measured, MeasuredExperiments, MeasuredString

SAMPLES_OF_SIZES: Final = 16
"""Samples of a string whose grains are drawn to see how small and large they can be."""

MARGIN: Final = 1.2
"""Sizes may lie outside those drawn by this factor; the classes at the ends take what is beyond."""


def census_layout(campaign: Any) -> Layouts | None:
    """Return the layout of the censuses of a campaign's samples; None where it has no data.

    Parameters
    ----------
    campaign
        The `Campaign`.
    """
    if campaign.experiments:
        own = ((each.name, _own_layout(each.campaign)) for each in campaign.experiments)
        return {name: layout for name, layout in own if layout is not None}
    return _own_layout(campaign)


def _own_layout(campaign: Any) -> CensusLayout | None:
    """Return the layout of a campaign without experiments, or of one of them."""
    if not (campaign.data or campaign.has_layout):
        return None
    own = {math.inf if time is None else time for time in data_times(campaign.data)}
    times = sorted(own | {time for time in campaign.output.census if time <= common_end(campaign)})
    volume = max(campaign.final.larger, default=1) if campaign.final else 1
    largest = (volume * campaign.most_grains) ** (1.0 / 3.0)
    drawn = list(_drawn_radii(campaign))
    smallest = min([1.0, *(low / MARGIN for low, _ in drawn)])
    largest = max([largest, *(high * MARGIN for _, high in drawn)])
    return CensusLayout.between(tuple(times), smallest, largest)


def common_end(campaign: Any) -> float:
    """Return the end of all samples in s; 0 where it differs between strings."""
    return fixed_end(campaign.scene.end_time, campaign.variables.of_scene) or 0.0


def with_census_of(campaign: Any, stored: Layouts | None) -> Any:
    """Return a campaign whose samples are counted as those of a file, if that suffices.

    A file may have censuses at more times than its campaign has data. A campaign with other
    experiments than the file is returned as it is.
    """
    names = {*stored} if isinstance(stored, Mapping) else set()
    others = names ^ {each.name for each in campaign.experiments}
    if stored is None or others or uncounted(campaign, stored):
        return campaign
    own = tuple(
        replace(each, campaign=replace(each.campaign, stored_census=layout_of(stored, each.name)))
        for each in campaign.experiments
    )
    return replace(campaign, experiments=own, stored_census=stored)


def uncounted(campaign: Any, stored: Layouts) -> str:
    """Return which datum of a campaign has no census in a file; empty if all have."""
    for name, own in [(each.name, each.campaign) for each in campaign.experiments] or [
        ("", campaign)
    ]:
        if absent := absent_time(layout_of(stored, name).times, own.data):
            return f"{name}: {absent}" if name else absent
    return ""


def measured(campaign: Any, string: ArrayLike) -> Measured:
    """Return the data of a campaign for the samples of a string, and the scales of their censuses.

    Raises
    ------
    ValueError
        If the campaign has no data, or a law refuses the string.
    """
    if campaign.experiments:
        own = ((each.name, each.campaign, each.own(string)) for each in campaign.experiments)
        return MeasuredExperiments({n: _own_measured(c, s) for n, c, s in own})
    return _own_measured(campaign, string)


def _own_measured(campaign: Any, string: ArrayLike) -> MeasuredString:
    """Return the same of a campaign without experiments, or of one of them."""
    if campaign.census is None:
        raise ValueError(f"{campaign.name} has no section data")
    section, values = campaign.at(string)
    diameter = 2.0 * grain_radius(section, values)
    tests = campaign.impact_tests_at(string) if exact_values(campaign.data).any() else None
    density, grains = values["density"], section.particles
    return MeasuredString(campaign.data, campaign.census, diameter, density, grains, tests)


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
